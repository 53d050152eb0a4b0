#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs the command-line tests on a built program.

usage: run.py --stgs PROGRAM --fixture MAKE_FIXTURE --source ROOT [unittest arguments]
"""
import argparse
import importlib.util
import os
import subprocess
import sys
import tempfile
import unittest

import harness

HERE = os.path.dirname(os.path.abspath(__file__))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--stgs", required=True)
    parser.add_argument("--fixture", required=True)
    parser.add_argument("--source", required=True)
    args, rest = parser.parse_known_args()
    for name in ("jsonschema",):
        if importlib.util.find_spec(name) is None:
            sys.exit(f"run.py: needs python3-{name} for {sys.executable}")
    harness.STGS = os.path.abspath(args.stgs)
    harness.SOURCE = os.path.abspath(args.source)
    with tempfile.TemporaryDirectory(prefix="stgs-fixture-") as folder:
        subprocess.run([args.fixture, folder], check=True)
        harness.FIXTURE = folder
        if rest:
            program = unittest.main(module=None, argv=["run.py", *rest], exit=False)
            sys.exit(not program.result.wasSuccessful())
        suite = unittest.defaultTestLoader.discover(HERE)
        result = unittest.TextTestRunner(verbosity=2).run(suite)
        sys.exit(not result.wasSuccessful())


if __name__ == "__main__":
    main()
