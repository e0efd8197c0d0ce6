"""The command `mcl-eval`, in this process."""

import signal
import sys

from . import _native


def main() -> int:
    """Run the command on the arguments of the process; returns its exit code."""
    # Python would only note the signal, until the command returns.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return _native.main(["mcl-eval", *sys.argv[1:]])
