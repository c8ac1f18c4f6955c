"""Measure a run with its video and print one JSON object: python benchmarks/video.py [--short]."""

import argparse
import json

from mjsheaf.bench.video import measure

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--short", action="store_true", help="a shorter run")
    print(json.dumps(measure(parser.parse_args().short), indent=2))
