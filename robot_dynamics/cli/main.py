"""The command `robot-dynamics VERB ...`: parses the command line and runs a verb."""

import argparse
import logging
import sys
from collections.abc import Sequence
from types import ModuleType

from robot_dynamics.errors import INTERRUPTED_EXIT_STATUS, RobotDynamicsError, describe_unknown_name
from robot_dynamics.optional_packages import missing_package_error
from robot_dynamics.version import package_version


def verb_modules() -> tuple[ModuleType, ...]:
    """Import the modules of the verbs. Raises MissingPackageError if a package that all need is not installed."""
    try:
        from robot_dynamics.cli import (
            collisions,
            convert,
            count,
            excite,
            frequencies,
            generate,
            identify,
            identify_payload,
            map,
            motion_report,
            replay_check,
            robots,
            schema,
            show,
            view,
        )
    except ModuleNotFoundError as error:
        raise missing_package_error(error, "robot-dynamics") from error
    recordings = (replay_check, identify, identify_payload, excite, motion_report, collisions)
    return show, view, convert, generate, count, map, frequencies, *recordings, robots, schema


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit status.

    The status is 0 after success, 1 after an error (with the reason on stderr), 130 after an interruption by the user,
    or the status that the verb returns.
    """
    try:
        verbs = verb_modules()
    except RobotDynamicsError as error:
        print(error, file=sys.stderr)
        return 1
    parser = build_parser(verbs)
    _refuse_unknown_verb(parser, sys.argv[1:] if arguments is None else arguments, [verb.NAME for verb in verbs])
    parsed, unknown = parser.parse_known_args(arguments)
    verb_parser = parsed.parser
    del parsed.parser  # verbs send their arguments to other processes
    if unknown:
        verb_parser.error(f"unrecognized arguments: {' '.join(unknown)}")
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")  # the encoding of the terminal may lack characters
    logging.basicConfig(format="%(levelname)s: %(message)s", level=logging.ERROR)  # verbs print warnings themselves
    logging.getLogger("robot_dynamics.model.formats").setLevel(logging.WARNING)  # except those of the parsers
    return run_verb(parsed)


def build_parser(modules: Sequence[ModuleType]) -> argparse.ArgumentParser:
    """Build the parser of the command line, with one subparser per verb."""
    parser = argparse.ArgumentParser(
        prog="robot-dynamics", description="Descriptions of robots and their dynamics, from the command line."
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {package_version()}")
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True)
    for verb in modules:
        description = verb.__doc__ or ""
        verb_parser = verbs.add_parser(
            verb.NAME,
            help=description.splitlines()[0],
            description=description,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        verb.add_arguments(verb_parser)
        verb_parser.set_defaults(run=verb.run, parser=verb_parser)  # whose usage an error shows
    return parser


def _refuse_unknown_verb(parser: argparse.ArgumentParser, arguments: Sequence[str], known: Sequence[str]) -> None:
    """Exit with the most similar verbs where the first argument is none of them: argparse lists all."""
    if arguments and not arguments[0].startswith("-") and arguments[0] not in known:
        parser.error(describe_unknown_name("verb", arguments[0], known))


def run_verb(parsed: argparse.Namespace) -> int:
    """Run the verb of parsed arguments, print its errors to stderr, and return the exit status."""
    from robot_dynamics.cli.terminal_text import escaped_output

    with escaped_output():
        return _run_verb(parsed)


def _run_verb(parsed: argparse.Namespace) -> int:
    from robot_dynamics.cli.output_files import discard_stdout, refuse_overwriting
    from robot_dynamics.cli.terminal_text import escape_line

    prefix = f"robot-dynamics {parsed.verb}"
    try:
        refuse_overwriting(parsed)
        status = parsed.run(parsed)
        sys.stdout.flush()
    except RobotDynamicsError as error:
        print(f"{prefix}: {escape_line(str(error))}", file=sys.stderr)
        return 1
    except ModuleNotFoundError as error:
        print(missing_package_error(error, prefix), file=sys.stderr)
        return 1
    except BrokenPipeError:  # the reader of stdout, such as a pager or head, has closed the pipe
        discard_stdout()
        return 1
    except KeyboardInterrupt:
        print(f"{prefix}: interrupted", file=sys.stderr)
        return INTERRUPTED_EXIT_STATUS
    except OSError as error:  # such as a full disk behind a redirection
        file = "" if error.filename is None else f"{error.filename}: "
        print(f"{prefix}: {file}{error.strerror}", file=sys.stderr)
        discard_stdout()
        return 1
    return status or 0


if __name__ == "__main__":
    sys.exit(main())
