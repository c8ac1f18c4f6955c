"""Measure the sheaf algebra and print one JSON object: python benchmarks/sheaf.py [--short]."""

import argparse
import json

from mjsheaf.bench.sheaf import measure

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--short", action="store_true", help="leave out the grid of a million vertices")
    print(json.dumps(measure(parser.parse_args().short), indent=2))
