"""Options of the page; quick to import, so that nodes can start before the page is."""

import argparse

HERE = "127.0.0.1"
_PORT = 8080


def add_page_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the page."""
    parser.add_argument("--port", type=_port, default=_PORT, metavar="N", help=f"port of the page (default: {_PORT})")
    parser.add_argument(
        "--host",
        default=HERE,
        metavar="ADDRESS",
        help="address that the page listens on, such as 0.0.0.0; except for this machine's own, the address of the "
        "page then contains a token (default: this machine only)",
    )


def _port(text: str) -> int:
    if not text.isdecimal() or not 0 < int(text) < 65536:
        raise argparse.ArgumentTypeError(f"{text!r} is not a port (1 to 65535)")
    return int(text)
