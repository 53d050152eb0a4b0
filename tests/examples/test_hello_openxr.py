#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""hello_openxr in the headset of the configured OpenXR runtime; exit code 77: no runtime found.

usage: test_hello_openxr.py HELLO_OPENXR MAKE_SCENE
"""
import os
import subprocess
import sys
import tempfile

UNSUPPORTED = 5


def main():
    program, make_scene = sys.argv[1:]
    environment = dict(os.environ, VK_INSTANCE_LAYERS="VK_LAYER_KHRONOS_validation",
                       VK_LAYER_ENABLES="VK_VALIDATION_FEATURE_ENABLE_"
                                        "SYNCHRONIZATION_VALIDATION_EXT")
    with tempfile.TemporaryDirectory() as folder:
        scene, eye = os.path.join(folder, "scene.stgs"), os.path.join(folder, "eye")
        subprocess.run([make_scene, scene], check=True)
        result = subprocess.run([program, scene, "30", eye, "0.5"], capture_output=True, text=True,
                                check=False, env=environment)
        print(result.stdout, result.stderr)
        if result.returncode == UNSUPPORTED:
            sys.exit(77)
        assert result.returncode == 0
        assert "30 frames rendered" in result.stdout and "was focused" in result.stdout
        assert "Validation" not in result.stdout + result.stderr
        images = []
        for side in "left", "right":
            with open(f"{eye}-{side}.png", "rb") as file:
                images.append(file.read())
        # The images are not uniform, and the eyes differ.
        assert min(map(len, images)) > 2000 and images[0] != images[1]


if __name__ == "__main__":
    main()
