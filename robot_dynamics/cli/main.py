"""robot-dynamics VERB ...: reads the command line and hands it to a verb."""

import argparse
import logging
import os
import sys

from robot_dynamics.errors import INTERRUPTED_EXIT_STATUS, RobotDynamicsError
from robot_dynamics.optional_packages import missing_package_error
from robot_dynamics.version import package_version


def verb_modules():
    """The modules of the verbs. Raises MissingPackageError where a package that all need is not installed."""
    try:
        from robot_dynamics.cli import (
            convert,
            count,
            excite,
            frequencies,
            generate,
            identify,
            map,
            replay_check,
            robots,
            schema,
            show,
        )
    except ModuleNotFoundError as error:
        raise missing_package_error(error, "robot-dynamics") from error
    return show, convert, generate, count, map, frequencies, replay_check, identify, excite, robots, schema


def main(arguments=None):
    """Run the command; returns its exit status: 0, 1 where it was refused, with the reason on stderr, 130
    where the user interrupted it, or what the verb says."""
    parser = argparse.ArgumentParser(
        prog="robot-dynamics", description="Descriptions of robots and their dynamics, from the command line."
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {package_version()}")
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True)
    try:
        modules = verb_modules()
    except RobotDynamicsError as error:
        print(error, file=sys.stderr)
        return 1
    from robot_dynamics.cli.output_files import refuse_overwriting

    for verb in modules:
        summary = verb.__doc__.splitlines()[0]
        verb_parser = verbs.add_parser(verb.NAME, help=summary, description=verb.__doc__,
                                       formatter_class=argparse.RawDescriptionHelpFormatter)  # fmt: skip
        verb.add_arguments(verb_parser)
        verb_parser.set_defaults(run=verb.run)
    parsed = parser.parse_args(arguments)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")  # a terminal without some character shows the others
    logging.basicConfig(format="%(levelname)s: %(message)s", level=logging.ERROR)  # verbs tell warnings themselves
    logging.getLogger("robot_dynamics.model.formats").setLevel(logging.WARNING)  # but what was left out of a text
    try:
        refuse_overwriting(parsed)
        status = parsed.run(parsed)
        sys.stdout.flush()
    except RobotDynamicsError as error:
        print(f"robot-dynamics {parsed.verb}: {error}", file=sys.stderr)
        return 1
    except ModuleNotFoundError as error:
        print(missing_package_error(error, f"robot-dynamics {parsed.verb}"), file=sys.stderr)
        return 1
    except BrokenPipeError:  # the reader of our output, a pager or head, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except KeyboardInterrupt:
        print(f"robot-dynamics {parsed.verb}: interrupted", file=sys.stderr)
        return INTERRUPTED_EXIT_STATUS
    except OSError as error:  # a full disk behind a redirection
        where = "" if error.filename is None else f"{error.filename}: "
        print(f"robot-dynamics {parsed.verb}: {where}{error.strerror}", file=sys.stderr)
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    return status or 0


if __name__ == "__main__":
    sys.exit(main())
