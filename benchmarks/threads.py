"""Measure independent runs on threads and print one JSON object: python benchmarks/threads.py [--short]."""

import argparse
import json

from mjsheaf.bench.threads import measure

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--short", action="store_true", help="fewer repetitions")
    print(json.dumps(measure(parser.parse_args().short), indent=2))
