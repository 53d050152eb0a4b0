#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Installs the npm packages of tests/web/package.json into build/npm: playwright-core, which drives
# Chromium, and engines, for tests of the player for browsers alone. Without npm or a network, it reports
# this and those tests are skipped.
# usage: npm.sh
set -eu

root=$(cd "$(dirname "$0")/../.." && pwd)
folder=$root/build/npm
if cmp -s "$root/tests/web/package-lock.json" "$folder/installed.json"; then
  echo "setup: all npm packages are installed"
  exit 0
fi
if ! command -v npm >/dev/null && ! "$root/tools/setup/setup.sh" npm; then
  echo "setup: npm is missing; tests in Chromium are skipped"
  exit 0
fi
mkdir -p "$folder"
cp "$root/tests/web/package.json" "$root/tests/web/package-lock.json" "$folder"
echo "setup: installing the npm packages of tests/web/package.json"
if ! (cd "$folder" && npm ci --ignore-scripts --no-audit --no-fund >npm.log 2>&1); then
  echo "setup: npm failed ($folder/npm.log); tests in Chromium are skipped"
  exit 0
fi
cp "$root/tests/web/package-lock.json" "$folder/installed.json"
