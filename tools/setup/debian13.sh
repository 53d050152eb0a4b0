#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Builds and tests the tree in Debian 13 (trixie), in a root folder made by debootstrap.
# usage: debian13.sh FOLDER [CTEST OPTION...]
#   FOLDER  holds the root and the build; existing content is reused (about 4 GB)
# Needs root, the package debootstrap and the network. MIRROR overrides the Debian mirror, which is
# otherwise that of this machine's apt sources.
set -eu

if [ $# -eq 0 ]; then
  echo "usage: debian13.sh FOLDER [CTEST OPTION...]" >&2
  exit 2
fi
if [ "$(id -u)" -ne 0 ] || ! command -v debootstrap >/dev/null; then
  echo "debian13: needs root and debootstrap" >&2
  exit 1
fi
source=$(cd "$(dirname "$0")/../.." && pwd)
mkdir -p "$1"
folder=$(cd "$1" && pwd)
shift
root=$folder/root
jobs=${JOBS:-$(nproc)}

# The first Debian mirror of the apt sources, in either of their formats.
mirror=${MIRROR:-$(cat /etc/apt/sources.list /etc/apt/sources.list.d/*.list \
  /etc/apt/sources.list.d/*.sources 2>/dev/null \
  | grep -Eo '^(deb|URIs:) .*' | grep -Eo 'https?://[^ ]*/debian/?( |$)' | head -n 1 | tr -d ' ')}

if [ ! -e "$root/ready" ]; then
  rm -rf "$root"
  debootstrap --variant=minbase --include=ca-certificates trixie "$root" \
    "${mirror:-http://deb.debian.org/debian}"
  touch "$root/ready"
fi
mkdir -p "$root/stgs" "$folder/build" "$root/build"
cp /etc/resolv.conf "$root/etc/resolv.conf"

# The mounts belong to a namespace of their own and end with it.
export root source folder jobs
# shellcheck disable=SC2016  # expanded in the inner shells
unshare -m sh -eu -c '
  mount --bind "$source" "$root/stgs"
  mount -o remount,bind,ro "$root/stgs"
  mount --bind "$folder/build" "$root/build"
  for name in dev proc sys; do mount --rbind "/$name" "$root/$name"; done
  mount -t tmpfs tmpfs "$root/tmp"
  exec chroot "$root" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LANG=C.UTF-8 JOBS="$jobs" \
    CCACHE_DIR=/build/ccache sh -eu -c "
    cd /stgs
    tools/setup/setup.sh core program web check
    cmake --preset check -B /build -DSTGS_WITH_CUDA=OFF
    cmake --build /build -j \$JOBS
    STGS_VALIDATED=1 ctest --test-dir /build --output-on-failure --no-tests=error -LE slow \
      -j \$JOBS \"\$@\"" sh "$@"
' sh "$@"
