"""The command line by `python -m autotune`, where the command itself is not on the path."""

from autotune.cli.main import main

if __name__ == "__main__":
    main()
