"""The command ``ambkit``: every outcome is an exit code and, on failure, one message.

Errors of the user exit with 2, internal errors with 1, Ctrl-C with 130. The commands are made from
the verbs (`ambkit.verbs`), which are imported where interrupts are already handled.
"""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

# Only modules that Python has loaded already: an interrupt during other imports would print a
# traceback.
TYPE_CHECKING = False

INTERRUPTED = 130  #: Exit code after Ctrl-C, as in shells: 128 and the signal's number.


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run a command and exit with its exit code."""
    standalone = arguments is None
    try:
        if standalone:
            sys.unraisablehook = _repeat_interrupt
            # Figures are written to files; matplotlib must not require a display.
            os.environ.pop("MPLBACKEND", None)
            gc.set_threshold(100_000, 50, 100)  # garbage collection took a tenth of a command
        from ambkit.base import progress
        from ambkit.cli import printing

        progress.of_a_command[:] = [arguments is None]
        printing.prepare()
        printing.written.clear()
        printing.heed_notes()
        argv = sys.argv[1:] if arguments is None else arguments
        debug = "--debug" in argv
        if standalone and not debug:  # overflow is visible in the results
            import warnings

            warnings.simplefilter("ignore", RuntimeWarning)
        code = _run([item for item in argv if item != "--debug"], debug)
    except KeyboardInterrupt:
        code = INTERRUPTED
    if code == INTERRUPTED:
        _interrupted()
    if standalone:
        import signal

        # All is done: Ctrl-C during interpreter shutdown would only print noise.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.exit(code)


def _repeat_interrupt(lost: Any) -> None:
    """Repeat a Ctrl-C that Python ignored within a callback, of which imports have many."""
    if not isinstance(lost.exc_value, KeyboardInterrupt):
        sys.__unraisablehook__(lost)
        return
    import _thread
    from threading import Timer

    again = Timer(0.01, _thread.interrupt_main)  # after the callback
    again.daemon = True
    again.start()


def _run(arguments: list[str], debug: bool) -> int:
    """Run a command; return 0, 2 for errors of the user, 1 for unexpected ones."""
    from ambkit.base.errors import AmbkitError

    try:
        code = _called(arguments)
        sys.stdout.flush()
        return code
    except BrokenPipeError:  # the reader has closed the pipe
        _silenced()
        return 0
    except Exception as error:
        if debug:  # the origin in the program
            import traceback

            traceback.print_exc()
        if isinstance(error, AmbkitError):
            return _refused(str(error), getattr(error, "command", None))
        if isinstance(error, MemoryError):
            return _refused("there is not enough memory for this many samples")
        if not isinstance(error, OSError):
            return _unforeseen(error)
        if not error.filename:
            _silenced()
        return _refused(
            f"{error.filename or 'the output cannot be written'}: {error.strerror or error}"
        )


def _called(arguments: list[str]) -> int:
    """Run the command of the arguments, and return its exit code."""
    from ambkit.cli import catalogue

    name, following = catalogue.called(arguments)
    if name in catalogue.VERBS:
        from ambkit.cli import from_verbs

        return from_verbs.run(name, following)
    match name:
        case "" | "-h" | "--help":
            print(catalogue.front(), end="")
        case "--version":
            import ambkit

            print(f"ambkit {ambkit.__version__}")
        case "--print-completion":
            from ambkit.cli import from_verbs

            print(from_verbs.completion(following))
        case _ if name in catalogue.GROUPS and (not following or following[0] in ("-h", "--help")):
            print(catalogue.of_group(name), end="")
        case _:
            raise catalogue.unknown(name, following)
    return 0


def _silenced() -> None:
    """Discard the contents of stdout: Python must not flush it at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _interrupted() -> None:
    """Report the files written so far, in a line."""
    from ambkit.base import progress
    from ambkit.cli import printing

    if progress.left:
        printing.note(f"\ninterrupted; {progress.left.pop()}")
        return
    written = printing.written
    files = f"wrote {', '.join(map(str, written))}" if written else "nothing was written"
    if len(written) > 3:
        files = f"wrote {len(written)} files below {os.path.commonpath(written)}"
    printing.note(f"\ninterrupted; {files}")


def _refused(message: str, command: str | None = None) -> int:
    """Print one message, and where to find help if the command line was invalid."""
    from ambkit.cli import printing

    hint = f"\ntry {command} --help" if command is not None else ""
    printing.note(f"ambkit: {message}{hint}")
    return 2


def _unforeseen(error: Exception) -> int:
    """Report an unexpected error in a line: its place, and what to do."""
    from ambkit.cli import printing

    trace, place = error.__traceback__, ""
    while trace is not None:
        name = trace.tb_frame.f_globals.get("__name__", "")
        if name.partition(".")[0] == "ambkit":
            place = f" in {name}, line {trace.tb_lineno}"
        trace = trace.tb_next
    message = str(error).strip().partition("\n")[0]
    what = f"{type(error).__name__}{f': {message[:200]}' if message else ''}{place}"
    printing.note(f"ambkit: {what}: this is an error of ambkit, please report it with the output "
                "of --debug")  # fmt: skip
    return 1
