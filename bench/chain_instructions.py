#!/usr/bin/env python3
"""Counts the instructions of a step of chains from 100 to 100 000 links with valgrind.

Usage: chain_instructions.py PATH/TO/constraint_sim_chain_scaling
Exits with 1 when the instructions a link differ by more than 20 %.
"""
import re
import subprocess
import sys

LINKS = (100, 1000, 10000, 100000)
STEPS = 2  # steps that the difference of two runs measures


def instructions(program, links, steps):
    run = subprocess.run(
        ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null", program, str(links),
         str(steps)], check=True, capture_output=True, text=True)
    return int(re.search(r"Collected : (\d+)", run.stderr).group(1))


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    counts = []
    print("%10s %22s" % ("links", "instructions per link"))
    for links in LINKS:
        steps = instructions(sys.argv[1], links, STEPS) - instructions(sys.argv[1], links, 0)
        counts.append(steps / STEPS / links)
        print("%10d %22.1f" % (links, counts[-1]), flush=True)
    spread = max(counts) / min(counts) - 1
    print("they differ by %.1f %%" % (100 * spread))
    sys.exit(spread > 0.2)


if __name__ == "__main__":
    main()
