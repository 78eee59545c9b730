"""Mutated messages against living services: none may end, grow, or fail to count what was bad.

python benchmarks/fuzz.py --messages 1000000 --seed 0
"""

import argparse
import logging
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # The campaign is the tests' own.

from benchmarks.machine import describe
from services.runtime.router import router
from tests.fuzz.campaign import SERVICES, run
from tests.fuzz.victims import victims


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--messages", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--services", nargs="+", default=SERVICES, choices=SERVICES)
    args = parser.parse_args()
    logging.disable(logging.CRITICAL)  # A warning per refusal, a million times.
    with router() as endpoint, victims(endpoint, tuple(args.services)) as living:
        outcome = run(living, args.messages, args.seed, print)
    print(describe("eclipse-zenoh", "pydantic", "msgpack", "viser"))
    print(
        f"{outcome.num_sent} messages in {outcome.seconds:.0f} s: {outcome.num_bad} bad and "
        f"{outcome.num_refused} refused, all counted; RSS {outcome.rss_mib[0][1]:.0f} -> "
        f"{outcome.rss_mib[-1][1]:.0f} MiB, {outcome.growth_mib:+.1f} MiB in the second half"
    )
    print("RSS, MiB:", *(f"{mib:.0f}" for _, mib in outcome.rss_mib))
    print(", ".join(f"{how} {num}" for how, num in outcome.how.most_common()))


if __name__ == "__main__":
    main()
