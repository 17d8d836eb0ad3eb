"""`./rig report`: one HTML page of a run that needs nothing beside it; see docs/report.md."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from hpmc.lcm_log import LogError

EXIT_USAGE = 2
PAGE = "report.html"
_FOLDER = Path(__file__).parent


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, without the usage."""

    def error(self, message: str) -> NoReturn:
        raise LogError(f"{message} (see ./rig report --help)")


def parse(argv: Sequence[str]) -> argparse.Namespace:
    parser = Parser(
        prog="./rig report", allow_abbrev=False,
        description="One HTML page of a run, with all pictures in it.",
    )  # fmt: skip
    parser.add_argument("run", type=Path, metavar="RUN", help="folder of a run, or any LCM log")
    parser.add_argument("-o", "--out", type=Path, metavar="FILE",
                        help=f"the page (default: {PAGE} in the run's folder)")  # fmt: skip
    parser.add_argument("--reach", type=_positive, metavar="N",
                        help="whose signals are shown, counted over the run from 1 (default: the "
                        "one with the largest position error)")  # fmt: skip
    return parser.parse_args(argv)


def _positive(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r}: must be a whole number from 1 on")
    return int(text)


def make_page(run: Path, reach: int | None = None) -> str:
    """The page as text. Raises LogError."""
    import jinja2

    from hpmc.report.gather import gather

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_FOLDER), autoescape=True, trim_blocks=True,
        lstrip_blocks=True, undefined=jinja2.StrictUndefined,
    )  # fmt: skip
    style = (_FOLDER / "page.css").read_text()
    return environment.get_template("page.html").render(style=style, **gather(run, reach))


def write_page(page: str, file: Path) -> None:
    """Whole or not at all. Raises LogError."""
    partial = file.with_name(file.name + ".partial")
    try:
        partial.write_text(page, encoding="utf-8")
        partial.replace(file)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise LogError(f"-o {file}: cannot be written: {error.strerror}") from None


def main(argv: Sequence[str]) -> int:
    try:
        options = parse(argv)
        beside = options.run / PAGE if options.run.is_dir() else options.run.with_suffix(".html")
        file = options.out or beside
        if file.is_dir():
            raise LogError(f"-o {file}: is a folder")
        if options.run.exists() and not file.parent.is_dir():  # said before the work
            raise LogError(f"-o {file}: there is no folder {file.parent}")
        page = make_page(options.run, options.reach)
        write_page(page, file)
    except LogError as error:
        print(f"rig report: {error}", file=sys.stderr)
        return EXIT_USAGE
    print(f"{file}  {file.stat().st_size / 1e6:.1f} MB")
    return 0
