"""`./rig node`: one motor node alone on a CAN bus, on the wall clock, for anyone's client."""

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from hpmc.layout import PROGRAMS

EXIT_USAGE = 2
HELP = """\
One motor node: the firmware itself, alone on a CAN bus, free-running on the wall clock. Any CANopen
client can be its master; the data sheet is firmware/od/motor_node.eds. Ctrl-C ends it.

The motor and the encoder are simulated: a single inertia with viscous and Coulomb friction, which
the node's torque accelerates; an incremental encoder that counts from zero at the start, with an
index pulse once per revolution; a motor current in proportion to the torque. The joint loop runs at
the SYNC rate times object 2100h:08, and at 1 kHz while no SYNC comes. The node has no reference
until it has been homed (mode 6, methods 33, 34, 37), unless --referenced says that its encoder is
absolute.

Without a CAN bus of your own, in two terminals:

  tools/with-vcan --name bus ./rig node --id 5 --can vcan0
  tools/with-vcan --join bus candump vcan0
"""


def whole(low: int, high: int) -> Callable[[str], int]:
    """A whole number from low to high, for argparse."""

    def parse(text: str) -> int:
        value = int(text, 0)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text}: must be {low} to {high}")
        return value

    parse.__name__ = "whole number"
    return parse


def not_below(low: float) -> Callable[[str], float]:
    """A number from low to a million, for argparse."""

    def parse(text: str) -> float:
        value = float(text)
        if not low <= value <= 1e6:
            raise argparse.ArgumentTypeError(f"{text}: must be {low:g} to 1e6")
        return value

    parse.__name__ = "number"
    return parse


def node_id(text: str) -> int:
    return 255 if text == "255" else whole(1, 127)(text)


def parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="./rig node", description=HELP, formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )  # fmt: skip
    parser.add_argument("--id", type=node_id, required=True, metavar="N",
                        help="node-id, 1 to 127, or 255: none until LSS gives one")  # fmt: skip
    parser.add_argument("--can", default="vcan0", metavar="IFACE",
                        help="CAN interface (%(default)s)")  # fmt: skip
    parser.add_argument("--serial", type=whole(1, 0xFFFFFFFF), metavar="N",
                        help="serial number, object 1018h:04 (the node-id)")  # fmt: skip
    parser.add_argument("--parameters", metavar="FILE",
                        help="memory of 1010h and LSS store; none when left out")  # fmt: skip
    parser.add_argument("--referenced", action="store_true",
                        help="the encoder is absolute: no homing is needed")  # fmt: skip
    parser.add_argument("--after-watchdog", action="store_true",
                        help="starts as after a reset by the watchdog")  # fmt: skip
    parser.add_argument("--internal-oscillator", action="store_true",
                        help="starts as without its crystal: enabling is refused")  # fmt: skip
    parser.add_argument("--temperature-dC", type=whole(-2730, 32767), default=250, metavar="N",
                        help="of the motor, in 0.1 degree Celsius (%(default)s)")  # fmt: skip
    parser.add_argument("--fixed", action="store_true",
                        help="joint controller in 32-bit integers instead of float")  # fmt: skip
    joint = parser.add_argument_group("the simulated joint")
    joint.add_argument("--inertia", type=not_below(1e-6), default=0.05, metavar="X",
                       help="kg m^2 (%(default)s)")  # fmt: skip
    joint.add_argument("--viscous-friction", type=not_below(0.0), default=0.05, metavar="X",
                       help="N m per rad/s (%(default)s)")  # fmt: skip
    joint.add_argument("--coulomb-friction", type=not_below(0.0), default=0.05, metavar="X",
                       help="N m (%(default)s)")  # fmt: skip
    joint.add_argument("--torque-constant", type=not_below(1e-6), default=5.0, metavar="X",
                       help="N m per A (%(default)s)")  # fmt: skip
    joint.add_argument("--index-rad", type=not_below(-1e6), default=0.5, metavar="X",
                       help="angle of the index pulse, from the start (%(default)s)")  # fmt: skip
    joint.add_argument("--angle-rad", type=not_below(-1e6), default=0.0, metavar="X",
                       help="where the encoder stands at the start (%(default)s)")  # fmt: skip
    joint.add_argument("--encoder-sign", type=int, choices=(1, -1), default=1,
                       help="-1: an encoder mounted the wrong way round (%(default)s)")  # fmt: skip
    return parser


def command(options: argparse.Namespace) -> list[str]:
    """The command line of the program motor_node."""
    words = [str(PROGRAMS["motor_node"]), "--free-running"]
    for name, value in vars(options).items():
        # ./rig node --fixed has chosen the program already (layout.PROGRAMS).
        if value is None or value is False or name == "fixed":
            continue
        words.append("--" + name.replace("_", "-"))
        if value is not True:
            words.append(str(value))
    return words


def main(argv: Sequence[str]) -> int:
    options = parser().parse_args(argv)
    if not Path("/sys/class/net", options.can).exists():
        print(
            f"rig node: there is no CAN interface '{options.can}' here; without one of your own:\n"
            f"     tools/with-vcan ./rig node --id {options.id} --can vcan0",
            file=sys.stderr,
        )
        return EXIT_USAGE
    print(f"motor node {options.id} on {options.can}; Ctrl-C ends it", file=sys.stderr, flush=True)
    words = command(options)
    return os.execv(words[0], words)
