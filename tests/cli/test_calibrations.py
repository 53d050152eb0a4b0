#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Calibrations of other tools: the cameras of the sample capture, written in the form of each tool,
give the same prepared cameras. They are of an eighth of its image size, and scaled when read."""
import json
import math
import os
import shutil
import unittest

import harness
from harness import CliTest, built_in

INVALID, NOT_BUILT = 3, 6


def rotation_vector(r):
    """Of a row-major rotation matrix by less than half a turn."""
    axis = [r[7] - r[5], r[2] - r[6], r[3] - r[1]]
    sine = math.hypot(*axis) / 2
    angle = math.atan2(sine, (r[0] + r[4] + r[8] - 1) / 2)
    return [0, 0, 0] if sine < 1e-12 else [value / (2 * sine) * angle for value in axis]


def intrinsics(camera):
    """K in OpenCV's convention: the centre of the first pixel is at 0."""
    return [[camera["fx"], 0.0, camera["cx"] - 0.5], [0.0, camera["fy"], camera["cy"] - 0.5],
            [0.0, 0.0, 1.0]]


def pose2sim(cameras):
    return {"Calib_scene.toml": "".join(
        f"[{camera['name']}]\nname = \"{camera['name'].replace('cam', 'cam_')}\"\n"
        f"size = [ {camera['width']}.0, {camera['height']}.0]\nmatrix = {intrinsics(camera)}\n"
        f"distortions = [ 0.0, 0.0, 0.0, 0.0]\nrotation = {rotation_vector(camera['rotation'])}\n"
        f"translation = {camera['translation']}\nfisheye = false\n\n"
        for camera in cameras) + "[metadata]\nadjusted = false\nerror = 0.0\n"}


def qualisys(cameras):
    text = "<?xml version='1.0'?>\n<calibration><cameras>\n"
    for camera in cameras:
        r, t = camera["rotation"], camera["translation"]
        centre = [-1000 * sum(r[3 * i + j] * t[i] for i in range(3)) for j in range(3)]
        sign = [1, 1, 1, -1, -1, -1, -1, -1, -1]
        turn = " ".join(f'r{i // 3 + 1}{i % 3 + 1}="{sign[i] * r[i]!r}"' for i in range(9))
        k = intrinsics(camera)
        text += (f'<camera active="1" serial="{camera["name"]}" viewrotation="0">\n'
                 f'<fov_video left="0" top="0" right="{camera["width"] - 1}" '
                 f'bottom="{camera["height"] - 1}"/>\n'
                 f'<transform x="{centre[0]!r}" y="{centre[1]!r}" z="{centre[2]!r}" {turn}/>\n'
                 f'<intrinsic focalLengthU="{64 * k[0][0]!r}" focalLengthV="{64 * k[1][1]!r}" '
                 f'centerPointU="{64 * k[0][2]!r}" centerPointV="{64 * k[1][2]!r}" skew="0" '
                 'radialDistortion1="0" radialDistortion2="0" radialDistortion3="0" '
                 'tangentalDistortion1="0" tangentalDistortion2="0"/></camera>\n')
    return {"Calib.qca.txt": text + "</cameras></calibration>\n"}


def opencv(cameras):
    def matrix(name, numbers, width):
        return (f"{name}: !!opencv-matrix\n   rows: {len(numbers) // width}\n   cols: {width}\n"
                f"   dt: d\n   data: {numbers}\n")
    return {camera["name"] + ".yml":
            f"%YAML:1.0\n---\nimage_width: {camera['width']}\nimage_height: {camera['height']}\n"
            + matrix("camera_matrix", sum(intrinsics(camera), []), 3)
            + matrix("R", camera["rotation"], 3) + matrix("T", camera["translation"], 1)
            for camera in cameras}


@unittest.skipUnless(built_in("prepare"), "needs a build with OpenCV")
class Calibrations(CliTest):
    def prepare(self, capture, output):
        result = self.stgs("prepare", capture, "-o", output, "--scale", "0.125", "--frames",
                           "0:2", "--no-split", "--max-static-points", "500")
        self.assertEqual(result.returncode, 0, result.stderr.decode())
        with open(self.path(output, "capture.json"), encoding="utf-8") as file:
            return json.load(file)

    def write_capture(self, name, files):
        os.makedirs(self.path(name, "calibration"))
        for video in os.listdir(harness.sample()):
            if video.endswith(".mp4"):
                shutil.copy(os.path.join(harness.sample(), video), self.path(name, video))
        for file, text in files.items():
            self.write(os.path.join(name, "calibration", file), text)

    def check_same(self, expected, found):
        names = {camera["name"]: camera for camera in found["cameras"]}
        self.assertEqual(set(names), {camera["name"] for camera in expected["cameras"]})
        for camera in expected["cameras"]:
            other = names[camera["name"]]
            for key in "width", "height":
                self.assertEqual(camera[key], other[key])
            for key in "fx", "fy", "cx", "cy", "rotation", "translation":
                pairs = zip(*([value] if isinstance(value, float) else value
                              for value in (camera[key], other[key])))
                for a, b in pairs:
                    self.assertAlmostEqual(a, b, delta=1e-6, msg=f"{camera['name']}: {key}")

    def test_each_form_gives_the_same_prepared_cameras(self):
        expected = self.prepare(harness.sample(), "expected")
        forms = {"opencv": opencv}
        if built_in("calibration"):
            forms.update(pose2sim=pose2sim, qualisys=qualisys)
        for name, write in forms.items():
            with self.subTest(form=name):
                self.write_capture(name, write(expected["cameras"]))
                found = self.prepare(name, name + " prepared")
                self.check_same(expected, found)
                self.assertEqual(found["metric"], name == "qualisys")

    def test_mistakes_are_named(self):
        cameras = self.prepare(harness.sample(), "prepared")["cameras"]
        keys = ("fx", "fy", "cx", "cy")
        half = [{**camera, **{key: camera[key] / 2 for key in keys}} for camera in cameras]
        one = [dict(camera) for camera in cameras]
        one[3]["translation"] = [1000 * value for value in one[3]["translation"]]
        for name, given, message in (
                ("half", half, "^stgs: error: half: .* the intrinsics are those of images of half the size .*; multiply them by 2"),
                ("mm", one, f"^stgs: error: mm: the calibration of '{one[3]['name']}' does not fit .* the position is in mm")):
            with self.subTest(name):
                self.write_capture(name, opencv(given))
                arguments = ["prepare", name, "-o", name + " out", "--frames", "0:1", "--no-split", "--scale", "0.5",
                             "--max-static-points", "500"]
                self.fails(INVALID, message, *arguments)
                self.assertFalse(os.path.exists(self.path(name + " out")))
        trusted = self.succeeds(*arguments, "--trust-calibration")
        self.assertIn(b"warning: calibration: " + name.encode(), trusted.stderr)

    @unittest.skipIf(built_in("calibration"), "this build reads all forms")
    def test_a_form_that_is_not_built_in_is_named(self):
        for file in "Calib.toml", "Calib.qca.txt":
            with self.subTest(file=file):
                self.write_capture(file + " capture", {file: "any content"})
                self.fails(NOT_BUILT, file + ": .*STGS_WITH_CALIBRATION", "prepare",
                           file + " capture", "-o", "out")


if __name__ == "__main__":
    unittest.main()
