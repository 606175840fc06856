"""The command ``quietfix``: mistakes are one line, and the exit status says how it went."""

from __future__ import annotations

import multiprocessing
import os
import sys
import warnings
from typing import Any, NoReturn

import typer
from typer.exceptions import TyperException

from quietfix.diagrams.commands.app import app

__all__ = ["app", "main"]

_STUDIES = ("run", "compare", "sweep", "verify", "replay")
"""Commands that use xarray."""


def _leave_dask_out() -> None:
    """Let xarray find out now that there is no dask, which it would import wherever it is installed.

    Nothing here has arrays of dask: it would take time and memory. Who asks for workers, or a user's own class, can
    import it as ever.
    """
    if "dask" in sys.modules or "xarray" in sys.modules:
        return
    modules: dict[str, Any] = sys.modules
    modules["dask"] = None
    try:
        import xarray

        xarray.Variable((), 0.0)  # it looks for dask when it makes the first one
    finally:
        del modules["dask"]


def _leave_the_pipe() -> NoReturn:
    """End where nobody reads any more: `quietfix show ... | head`."""
    sys.stderr.close()
    sys.exit(0)


def main(arguments: list[str] | None = None) -> None:
    """Run the command; a user's mistake is one line on standard error and exit status 2."""
    from quietfix.diagrams.schema.errors import UserError

    if getattr(multiprocessing.current_process(), "_inheriting", False):
        os._exit(2)  # a script without `if __name__ == "__main__":` that a worker imports; who started it says so
    formatwarning, warnings.formatwarning = warnings.formatwarning, _format_warning
    sys.path.append("")  # a user's own class may lie in the folder where the command is given
    try:
        given = sys.argv[1:] if arguments is None else arguments
        _check_encoding(given)
        if given[:1] and given[0] in _STUDIES and not {"-h", "--help"} & set(given):
            _leave_dask_out()
        status = app(args=arguments, standalone_mode=False, prog_name="quietfix")
        sys.stdout.flush()
    except UserError as error:
        _fail(str(error), 2)
    except TyperException as error:
        # Usage errors of the parser: unknown options and commands, values of the wrong type.
        message = error.format_message() if hasattr(error, "format_message") else str(error)
        _fail(f"{message.rstrip('.')}; see `quietfix --help`", 2)
    except (KeyboardInterrupt, typer.Abort):
        _fail("interrupted", 130)
    except SystemExit as error:
        if isinstance(error.__context__, BrokenPipeError):  # the parser's way to say it
            _leave_the_pipe()
        # else the parser does not exit by itself here, so a user's class or file has
        _fail(f"a class of the user's ended the program (SystemExit: {error})", 2)
    except MemoryError:
        _fail("the memory is not enough; fewer trials at once (--chunk), a shorter duration_s or fewer particles", 2)
    except BrokenPipeError:
        _leave_the_pipe()
    except OSError as error:  # what commands write is looked after there: this is the terminal, or a file behind `>`
        _fail(f"{error.filename or 'the output'} cannot be written ({error.strerror or error})", 2)
    finally:
        warnings.formatwarning = formatwarning
    if status == 130:  # Typer's own handling of Ctrl-C
        _fail("interrupted", 130)
    sys.exit(status if isinstance(status, int) else 0)


def _check_encoding(arguments: list[str]) -> None:
    """Refuse bytes that are no text: they can be neither printed nor put into a result."""
    from quietfix.diagrams.schema.errors import UserError

    for i, argument in enumerate(arguments, 1):
        try:
            argument.encode()
        except UnicodeEncodeError:
            shown = argument.encode(errors="backslashreplace").decode()
            raise UserError(f"argument {i}: {shown} is not allowed; text in UTF-8") from None


def _format_warning(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, line: str | None = None
) -> str:
    """Write a warning as one line in the user's words, without the place in the source."""
    return f"quietfix: warning: {message}\n"


def _fail(message: str, status: int) -> NoReturn:
    from quietfix.diagrams.schema.errors import one_line

    print(f"quietfix: {one_line(message)}", file=sys.stderr)
    sys.exit(status)


if __name__ == "__main__":
    main()
