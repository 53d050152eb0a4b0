#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Encodes the sample capture and verifies the result.
# usage: demo.sh STGS OUT     STGS: the program; OUT: output folder, replaced
set -eu

stgs=$1
out=$2
sample=$(dirname "$0")/../../tests/data/workshop
camera=cam00  # held out of training
frame=10

step() { printf '\n== %s\n' "$*"; }
run() {
  printf '$ %s\n' "$*"
  "$@"
}

rm -rf "$out"
mkdir -p "$out"
start=$(date +%s)

step "encode: 9 cameras, 20 frames"
run "$stgs" encode "$sample" -o "$out/workshop.stgs" --preset fast --quality 90 --keep-work "$out/work"

step "validate"
run "$stgs" validate "$out/workshop.stgs"

step "render held-out camera $camera next to the ground truth"
run "$stgs" render "$out/workshop.stgs" --cameras "$out/work/prepared" --which "$camera" \
  --frames "$frame:$((frame + 1))" --side-by-side -o "$out/side-by-side.png"
run "$stgs" render "$out/workshop.stgs" --cameras "$out/work/prepared" --which "$camera" \
  --frames 0: --side-by-side -o "$out/side-by-side.mp4"

step "evaluate on $camera"
"$stgs" evaluate "$out/workshop.stgs" --against "$out/work/prepared" --cameras "$camera" \
  --format json >"$out/evaluate.json"
"$stgs" info "$out/workshop.stgs" --format json >"$out/info.json"

seconds=$(($(date +%s) - start))
step "done"
python3 - "$out" "$seconds" "$camera" <<'PYTHON'
import json, os, sys
out, seconds, camera = sys.argv[1:]
scores = json.load(open(f"{out}/evaluate.json"))
size = os.path.getsize(f"{out}/workshop.stgs")
primitives = json.load(open(f"{out}/info.json"))["primitives"]
print(f"PSNR   {scores['psnr']:.2f} dB on {camera} (SSIM {scores['ssim']:.3f}), held out of training")
print(f"size   {size} bytes, {primitives} primitives, {size / primitives:.1f} bytes each")
print(f"time   {seconds} s")
print(f"images {out}/side-by-side.png, {out}/side-by-side.mp4: render left, ground truth right")
PYTHON

case $("$stgs" --version) in
  *" serve"*) printf '\nSee it in a browser:\n  %s serve %s\n' "$stgs" "$out/workshop.stgs" ;;
esac
