#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Prints the CMake option that leaves CUDA out, on a machine without an NVIDIA driver.
if [ ! -e /proc/driver/nvidia/version ] && [ ! -e /usr/lib/wsl/lib/libcuda.so.1 ]; then
  echo "No NVIDIA driver found: building without CUDA" >&2
  echo "-DSTGS_WITH_CUDA=OFF"
else
  echo "-DSTGS_WITH_CUDA=AUTO"
fi
