"""Measure the assembly of a thousand vehicles and print one JSON object: python benchmarks/assembly.py [--short]."""

import argparse
import json

from mjsheaf.bench.assembly import measure

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--short", action="store_true", help="fewer repetitions")
    print(json.dumps(measure(parser.parse_args().short), indent=2))
