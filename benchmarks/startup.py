"""Measure how long it takes to begin and print one JSON object: python benchmarks/startup.py [--short]."""

import argparse
import json

from mjsheaf.bench.startup import measure

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--short", action="store_true", help="fewer repetitions")
    print(json.dumps(measure(parser.parse_args().short), indent=2))
