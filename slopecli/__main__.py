"""`python -m slopecli` is the `slopemap` command."""

from slopecli.cli import main

if __name__ == "__main__":
    main()
