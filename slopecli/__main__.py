"""`python -m slopecli` is the `slopemap` command."""

import sys

if __name__ == "__main__":
    try:
        from slopecli.cli import main
    except KeyboardInterrupt:
        sys.stderr.write("slopemap: error: interrupted\n")
        sys.exit(130)
    main()
