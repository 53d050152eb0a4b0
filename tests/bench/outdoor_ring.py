#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Renders a synthetic outdoor capture: 12 cameras in a ring, 30 degrees apart, that look inwards.

usage: outdoor_ring.py FOLDER     needs NumPy; takes two minutes

A meadow with a path, a table and two balls that move, a fence, 16 trees, hills, and a sky with
clouds. Layout 'videos' with frames as PNG; cam03 and cam08 are held out. Rigs that people own look
like this, with the same difficulties: a background at any distance, repeated objects, and surfaces
that one camera alone sees. The images are exact up to their supersampling.
"""
import json
import os
import struct
import sys
import zlib

import numpy as np

WIDTH, HEIGHT, SAMPLES = 320, 180, 2  # pixels; samples per pixel and axis
CAMERAS, FRAMES, HELD_OUT = 12, 12, (3, 8)
FOCAL = 0.75 * WIDTH
FAR = 1e9


def lattice(points):
    """Returns a pseudorandom value in [0, 1] for each point of an integer lattice."""
    p = points.astype(np.int64)
    h = (p[..., 0] * 374761393 + p[..., 1] * 668265263 + p[..., 2] * 2147483647) & 0xffffffff
    h = ((h ^ (h >> 13)) * 1274126177) & 0xffffffff
    return ((h ^ (h >> 16)) & 0xffff) / 65535.0


def noise(points):
    base = np.floor(points)
    f = points - base
    f = f * f * (3 - 2 * f)
    total = 0
    for corner in np.ndindex(2, 2, 2):
        weights = np.where(np.array(corner) == 1, f, 1 - f)
        total = total + weights.prod(-1) * lattice(base + np.array(corner))
    return total


def texture(points, octaves=4):
    return sum(0.5 ** (k + 1) * noise(points * 2 ** k + 17 * k) for k in range(octaves))


def mix(a, b, share):
    a = np.asarray(a, float)
    return a + (np.asarray(b) - a) * share[..., None]


def shade(normals):
    return (0.55 + 0.45 * np.clip(normals @ np.array([.4, .3, .86]), 0, 1))[..., None]


class Image:
    """The nearest colour along each ray of one camera at `origin`."""

    def __init__(self, origin, rays):
        self.origin, self.rays = origin, rays
        self.depth = np.full(rays.shape[:-1], FAR)
        self.colour = np.zeros(rays.shape)

    def copy(self):
        other = Image(self.origin, self.rays)
        other.depth, other.colour = self.depth.copy(), self.colour.copy()
        return other

    def add(self, depth, valid, paint):
        """Paints where a surface is the nearest; paint(points) returns its colours."""
        nearer = valid & (depth > 0.05) & (depth < self.depth)
        points = self.origin + depth[nearer][:, None] * self.rays[nearer]
        self.depth[nearer] = depth[nearer]
        self.colour[nearer] = paint(points)

    def sphere(self, centre, radius, paint):
        to = self.origin - centre
        b = (self.rays * to).sum(-1)
        square = b * b - (to @ to - radius * radius)
        self.add(-b - np.sqrt(np.maximum(square, 0)), square > 0,
                 lambda p: paint(p, (p - centre) / radius))

    def cylinder(self, centre, radius, low, high, paint, inside=False):
        """A vertical cylinder; `inside`: its far wall, seen from within."""
        d, to = self.rays, self.origin[:2] - centre
        a = np.maximum(d[..., 0] ** 2 + d[..., 1] ** 2, 1e-9)
        b = d[..., 0] * to[0] + d[..., 1] * to[1]
        square = b * b - a * (to @ to - radius * radius)
        root = np.sqrt(np.maximum(square, 0))
        depth = (-b + root if inside else -b - root) / a
        z = self.origin[2] + depth * d[..., 2]
        self.add(depth, (square > 0) & (z > low) & (z < high), paint)


def paint_sky(image):
    d = image.rays
    sky = mix([.80, .87, .95], [.30, .50, .85], np.sqrt(np.clip(d[..., 2], 0, 1)))
    sky = mix(sky, [.97, .97, .98], np.clip((texture(d * 4 + 5, 5) - .5) * 5, 0, 1))
    azimuth = np.arctan2(d[..., 1], d[..., 0])
    around = np.stack([np.cos(azimuth) * 4, np.sin(azimuth) * 4, 0 * azimuth], -1)
    hills = mix([.35, .45, .42], [.55, .65, .70], texture(d * 60, 3))
    is_hill = d[..., 2] < 0.05 + 0.10 * texture(around)
    image.colour[:] = np.where(is_hill[..., None], hills, sky)


def paint_ground(points):
    blades = texture(points * 3) * .6 + texture(points * .5, 3) * .4
    grass = mix([.18, .30, .08], [.55, .60, .25], blades)
    path = mix([.45, .38, .28], [.75, .68, .55], texture(points * 6))
    on_path = np.abs(points[:, 0] + .3 * np.sin(points[:, 1])) < .8
    return np.where(on_path[:, None], path, grass)


def add_tree(image, base, trunk, height, crown):
    def bark(points):
        normals = np.concatenate([(points[:, :2] - base) / trunk, 0 * points[:, :1]], -1)
        return mix([.20, .13, .08], [.50, .38, .26], texture(points * [8, 8, 2])) * shade(normals)

    def leaves(points, normals):
        return mix([.06, .16, .04], [.40, .58, .20], texture(points * 4)) * shade(normals)

    image.cylinder(base, trunk, 0, height, bark)
    for j in range(5):
        side = np.array([np.cos(j * 2.4), np.sin(j * 2.4)]) * crown * .5 * (j > 0)
        centre = np.array([*(base + side), height + crown * (.5 + .25 * np.sin(3 * j))])
        image.sphere(centre, crown * (.9 if j == 0 else .65), leaves)


def add_fence(image):
    for k in range(56):
        angle = 2 * np.pi * k / 56
        image.cylinder(8 * np.array([np.cos(angle), np.sin(angle)]), .07, 0, 1.3, lambda p:
                       np.array([.72, .62, .48]) * (.55 + .6 * texture(p * 5, 3))[:, None])
    for low, high in ((.45, .57), (1.0, 1.12)):
        image.cylinder(np.zeros(2), 8, low, high, lambda p:
                       np.array([.68, .55, .40]) * (.6 + .5 * texture(p * [3, 3, 20], 3))[:, None],
                       inside=True)


def add_table(image):
    for leg in ([1.2, .5], [1.9, .5], [1.2, 1.2], [1.9, 1.2]):
        image.cylinder(np.array(leg), .05, 0, .8, lambda p: np.tile([.35, .2, .12], (len(p), 1)))
    z = np.where(np.abs(image.rays[..., 2]) < 1e-6, 1e-6, image.rays[..., 2])
    depth = (.8 - image.origin[2]) / z
    p = image.origin + depth[..., None] * image.rays
    top = (p[..., 0] > 1.1) & (p[..., 0] < 2) & (p[..., 1] > .4) & (p[..., 1] < 1.3)
    image.add(depth, top, lambda p: mix([.45, .25, .15], [.75, .5, .3], texture(p * [3, 20, 1], 3)))


def static_image(origin, rays):
    image = Image(origin, rays)
    paint_sky(image)
    down = np.minimum(rays[..., 2], -1e-6)
    depth = -origin[2] / down
    image.add(depth, (rays[..., 2] < 0) & (depth < 120), paint_ground)
    random = np.random.default_rng(3)
    for k in range(16):
        angle = 2 * np.pi * (k + random.uniform(-.3, .3)) / 16
        base = random.uniform(13, 22) * np.array([np.cos(angle), np.sin(angle)])
        add_tree(image, base, random.uniform(.18, .35), random.uniform(2.2, 3.4),
                 random.uniform(1.5, 2.6))
    add_fence(image)
    add_table(image)
    return image


def add_balls(image, frame):
    for j, dark in enumerate(([.15, .3, .8], [.85, .2, .15])):
        phase = frame * 4 * np.pi / 48 + j * 2.5
        centre = np.array([1.1 * np.cos(phase) - .6, 1.1 * np.sin(phase) - .4,
                           .5 + .5 * abs(np.sin(2 * phase))])

        def checks(_, normals, dark=dark):
            around = np.arctan2(normals[:, 1], normals[:, 0])
            odd = (np.floor(normals[:, 2] * 3) + np.floor(around * 2)) % 2
            return mix(dark, [.95, .9, .6], odd) * shade(normals)

        image.sphere(centre, .38, checks)


def write_png(path, pixels):
    def chunk(kind, data):
        return (struct.pack(">I", len(data)) + kind + data +
                struct.pack(">I", zlib.crc32(kind + data)))

    height, width, _ = pixels.shape
    rows = b"".join(b"\0" + row.tobytes() for row in pixels)
    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n" +
                   chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)) +
                   chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def film(folder, camera):
    """Writes the frames of a camera and returns its entry in cameras.json."""
    angle = 2 * np.pi * camera / CAMERAS
    origin = np.array([4 * np.cos(angle), 4 * np.sin(angle), 1.5 + .25 * (camera % 3)])
    forward = np.array([0, 0, 1.1]) - origin
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    x, y = np.meshgrid(((np.arange(WIDTH * SAMPLES) + .5) / SAMPLES - WIDTH / 2) / FOCAL,
                       ((np.arange(HEIGHT * SAMPLES) + .5) / SAMPLES - HEIGHT / 2) / FOCAL)
    rays = np.stack([x, y, np.ones_like(x)], -1) @ rotation
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    name = f"cam{camera:02d}"
    os.makedirs(os.path.join(folder, name))
    background = static_image(origin, rays)
    for frame in range(FRAMES):
        image = background.copy()
        add_balls(image, frame)
        colour = image.colour.reshape(HEIGHT, SAMPLES, WIDTH, SAMPLES, 3).mean((1, 3))
        write_png(os.path.join(folder, name, f"{frame:06d}.png"),
                  (np.clip(colour, 0, 1) * 255 + .5).astype(np.uint8))
    pose = np.eye(4)
    pose[:3, :3] = rotation
    pose[:3, 3] = -rotation @ origin
    return {"name": name, "K": [[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1]],
            "w2c": pose.tolist(), "test": camera in HELD_OUT}


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    folder = sys.argv[1]
    try:
        os.makedirs(folder)
    except OSError as error:
        sys.exit(f"{folder}: cannot create the folder: {error.strerror}; name a new folder")
    cameras = [film(folder, camera) for camera in range(CAMERAS)]
    with open(os.path.join(folder, "cameras.json"), "w", encoding="utf-8") as file:
        json.dump({"metric": True, "pixel_centre": 0.5, "fps": 30, "cameras": cameras}, file)


if __name__ == "__main__":
    main()
