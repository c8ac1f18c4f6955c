"""Install the package, editable, into this Python's environment: `.venv/bin/python tools/install.py '.[dev]'`.

uv does so in a tenth of pip's time. It reads none of pip's settings, so those that say where packages are go to it as
variables. Where uv cannot be had, or finds less than pip, pip installs. Both take the tested versions.
"""

import ast
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

PIP = [sys.executable, "-m", "pip", "--disable-pip-version-check"]
TESTED = "constraints.txt"  # in this repository; uv splits paths at spaces
OF_UV = {
    "index-url": "UV_DEFAULT_INDEX",
    "extra-index-url": "UV_INDEX",
    "find-links": "UV_FIND_LINKS",
    "no-index": "UV_NO_INDEX",
    "constraint": "UV_CONSTRAINT",
    "cert": "SSL_CERT_FILE",
    "proxy": "ALL_PROXY",
}
"""What uv calls pip's settings."""


def settings_for_uv(listed: str, given: Mapping[str, str]) -> dict[str, str]:
    """Translate what `pip config list` prints, lines of `section.name=repr`, into variables that uv reads.

    What is set for `pip install` counts before what is set for all of pip, and pip's variables before both, as for pip.
    Variables of uv that are given stay as they are.
    """
    found = {"UV_INDEX_STRATEGY": "unsafe-best-match"}  # the newest of all indexes, as pip takes it
    for section in ("global.", "install.", ":env:."):
        for line in listed.splitlines():
            name, _, value = line.partition("=")
            variable = OF_UV.get(name.removeprefix(section))
            if name.startswith(section) and variable is not None:
                separator = "," if variable == "UV_FIND_LINKS" else " "
                found[variable] = separator.join(ast.literal_eval(value).split())
    found |= {name: given[name] for name in OF_UV.values() if name in given}
    # uv leaves constraints of its variable out if it is called with others.
    return {**found, "UV_CONSTRAINT": f"{TESTED} {found.get('UV_CONSTRAINT', '')}".rstrip()}


def main(package: str) -> int:
    """Install, and return the exit status."""
    arguments = ["--quiet", "--editable", package]
    os.chdir(Path(__file__).parents[1])
    uv = Path(sys.executable).with_name("uv")
    if not uv.exists():
        command = [*PIP, "install", "--quiet", "--constraint", TESTED, "uv"]
        subprocess.run(command, stderr=subprocess.DEVNULL, check=False)
    if uv.exists():
        loud = {name: value for name, value in os.environ.items() if name != "PIP_QUIET"}  # which lists nothing
        listed = subprocess.run([*PIP, "config", "list"], capture_output=True, text=True, env=loud, check=False)
        environment = {**os.environ, **settings_for_uv(listed.stdout, os.environ)}
        command = [str(uv), "pip", "install", "--python", sys.executable, *arguments]
        # Settings that pip cannot read are not known: pip says so itself.
        if listed.returncode == 0 and subprocess.run(command, env=environment, check=False).returncode == 0:
            return 0
        print("uv could not install everything: pip does", file=sys.stderr)
    return subprocess.run([*PIP, "install", "--no-compile", "--constraint", TESTED, *arguments], check=False).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
