"""The signals that end a run and a served simulation."""

import signal


def end_signals() -> tuple[signal.Signals, ...]:
    """Return what ends a run: ctrl-C, a request to end, and a lost terminal or network connection.

    Under nohup the last of them is ignored and stays so.
    """
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        return (signal.SIGINT, signal.SIGTERM)
    return (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
