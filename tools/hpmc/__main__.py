"""`python -m hpmc`: the command line behind ./rig."""

import sys

from hpmc.cli import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
