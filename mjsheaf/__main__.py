"""`python -m mjsheaf`, the same as the command."""

from mjsheaf.cli import main

if __name__ == "__main__":
    main()
