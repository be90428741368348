"""The application of the page, made more than once in a process."""

from nicegui import core
from starlette.types import ASGIApp

from rover_hil.bench.server import make_app
from rover_hil.bench.session import Session

TOKEN = "token-of-tests"  # noqa: S105


def new_application(session: Session) -> ASGIApp:
    """Return the application of a session; NiceGUI's own, of which there is one, begins anew."""
    core.app.middleware_stack = None
    return make_app(session, "robotino", TOKEN)
