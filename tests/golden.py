"""Write a golden file for every example that has none: `python -m tests.golden`.

A golden file that exists is never written again: it stands for the bytes that are out there.
"""

from pathlib import Path

from schemas.codec import encode
from tests.examples import ENVELOPE, EXAMPLES

GOLDEN = Path(__file__).parent / "unit" / "golden"


def main() -> None:
    for name, (_, message) in EXAMPLES.items():
        path = GOLDEN / f"{name}.msgpack"
        if not path.exists():
            path.write_bytes(encode(message, ENVELOPE).join())


if __name__ == "__main__":
    main()
