#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Installs the packages of tools/setup/packages.txt that are missing.
# usage: setup.sh [--print] SECTION...    sections: core, program, web, check, npm, check-all
#   --print  prints the names of the packages, one per line, and installs nothing
# Exit code 0: all packages are installed; 1: a package could not be installed; 2: usage.
set -eu

list=$(dirname "$0")/packages.txt
print=no
if [ "${1:-}" = --print ]; then
  print=yes
  shift
fi
if [ $# -eq 0 ]; then
  echo "usage: setup.sh [--print] SECTION...    sections: core, program, web, check, npm, check-all" >&2
  exit 2
fi

# The lines of the given sections.
lines=
for section; do
  part=$(awk -v section="[$section]" \
    '/^\[/ { inside = ($0 == section) } inside && /^[a-z0-9]/' "$list")
  if [ -z "$part" ]; then
    echo "setup: packages.txt has no section '$section'" >&2
    exit 2
  fi
  lines="$lines$part
"
done
names=$(printf '%s' "$lines" | cut -d ' ' -f 1)
if [ $print = yes ]; then
  echo "$names"
  exit 0
fi

if ! command -v dpkg-query >/dev/null || ! command -v apt-get >/dev/null; then
  echo "setup: this is not a Debian system; install the equivalents of these packages:"
  printf '%s' "$lines" | sed 's/^/  /'
  echo "setup: continuing with the installed packages"
  exit 0
fi

missing=
for package in $names; do
  state=$(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null || true)
  [ "$state" = installed ] || missing="$missing $package"
done
if [ -z "$missing" ]; then
  echo "setup: all packages are installed"
  exit 0
fi

echo "setup: installing with apt-get:"
for package in $missing; do
  printf '%s' "$lines" | grep "^$package " | sed 's/^/  /'
done

as_root=
if [ "$(id -u)" -ne 0 ]; then
  if ! command -v sudo >/dev/null; then
    echo "setup: root privileges are needed; run as root: apt-get install$missing" >&2
    exit 1
  fi
  as_root=sudo
fi

# env after sudo: sudo resets the environment.
apt() { $as_root env DEBIAN_FRONTEND=noninteractive apt-get -qq "$@" >"$log" 2>&1; }
log=$(mktemp)
trap 'rm -f "$log"' EXIT
if ! apt update; then
  cat "$log" >&2
  echo "setup: apt-get update failed; check the network. Missing packages:$missing" >&2
  exit 1
fi
# shellcheck disable=SC2086  # word splitting is intended
if ! apt install --no-install-recommends --yes $missing; then
  tail -n 30 "$log" >&2
  echo "setup: apt-get could not install:$missing" >&2
  exit 1
fi
echo "setup: done"
