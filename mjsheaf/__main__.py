"""The command `mjsheaf`, also `python -m mjsheaf`."""

import sys


def start() -> None:
    """Run the command line and exit."""
    try:
        from mjsheaf.cli import main
    except KeyboardInterrupt:  # as libraries are loaded, before `stoppable`
        print("mjsheaf: interrupted; nothing was written", file=sys.stderr)
        sys.exit(130)
    main()


if __name__ == "__main__":
    start()
