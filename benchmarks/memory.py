"""Measure the peak memory of long runs and print one JSON object: python benchmarks/memory.py [--short]."""

import argparse
import json

from mjsheaf.bench.memory import measure

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--short", action="store_true", help="shorter runs")
    print(json.dumps(measure(parser.parse_args().short), indent=2))
