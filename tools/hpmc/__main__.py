"""`python -m hpmc`: the command line behind ./rig."""

import sys

EXIT_INTERRUPTED = 130

try:
    from hpmc.cli import main

    if __name__ == "__main__":
        sys.exit(main(sys.argv[1:]))
except KeyboardInterrupt:  # also while modules are still being loaded
    print("rig: interrupted", file=sys.stderr)
    sys.exit(EXIT_INTERRUPTED)
