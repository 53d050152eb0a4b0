#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Reports source files that clang-format would change.

usage: check_format.py ROOT CLANG_FORMAT     exit code 0: clean; 1: unformatted files; 77: skipped
"""
import re
import subprocess
import sys

import check_sources

VERSION = 14  # as in Debian 12; other versions format a few constructs differently
SKIPPED = 77


def main():
    root, program = sys.argv[1:]
    version = subprocess.run([program, "--version"], capture_output=True, text=True, check=True)
    match = re.search(r"version (\d+)", version.stdout)
    if not match or int(match.group(1)) != VERSION:
        print(f"skipped: needs clang-format {VERSION}, found: {version.stdout.strip()}")
        sys.exit(SKIPPED)
    files = check_sources.source_files(root, check_sources.CODE)
    result = subprocess.run([program, "--style=file", "--dry-run", "--Werror", *files], cwd=root,
                            capture_output=True, text=True, check=False)
    wrong = sorted({line.split(":")[0] for line in result.stderr.splitlines() if ": error:" in line})
    for path in wrong:
        print(f"{path}: not formatted; run: clang-format -i {path}")
    if result.returncode != 0 and not wrong:
        print(result.stderr)
    print(f"{len(files)} files, {len(wrong)} not formatted")
    sys.exit(1 if result.returncode != 0 else 0)


if __name__ == "__main__":
    main()
