"""When the rover may move, and why it must not."""

from controllers.safety.supervisor import Mode, SafetySupervisor

__all__ = ["Mode", "SafetySupervisor"]
