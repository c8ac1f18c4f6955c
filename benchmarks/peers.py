"""Measure vehicle-steps per second, ours and those of peers, and print one JSON object.

python benchmarks/peers.py [--short] measures ours, and the peers that are installed beside mjsheaf. Most want other
versions of what mjsheaf needs: install each into an environment of its own, and let its Python measure it with

    PYTHONPATH=. PATH_OF_THAT_PYTHON benchmarks/peers.py --peers-only
"""

import argparse
import json

from mjsheaf.bench.peers import measure, measure_peers

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help="fewer repetitions")
    parser.add_argument("--peers-only", action="store_true", help="leave out ours")
    arguments = parser.parse_args()
    print(json.dumps(measure_peers() if arguments.peers_only else measure(arguments.short), indent=2))
