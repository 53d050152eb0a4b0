/* SPDX-License-Identifier: Apache-2.0 */
#include "unity_camera.h"

#include <math.h>

/* Returns an element of a column-major matrix. */
static double at(const float* m, int row, int column) {
  return m[4 * column + row];
}

static int is_affine(const float* m) {
  return at(m, 3, 0) == 0 && at(m, 3, 1) == 0 && at(m, 3, 2) == 0 && at(m, 3, 3) == 1;
}

/* Computes the 3x4 matrix from the scene to an OpenCV camera, including the scale of the game
 * object. A Unity camera looks along -z with y up, and y of the scene is -y of the game object. */
static void scene_to_camera(const stgs_unity_camera* camera, double out[3][4]) {
  static const double camera_sign[3] = {1, -1, -1}, scene_sign[4] = {1, -1, 1, 1};
  int row, column, k;
  for (row = 0; row < 3; ++row) {
    for (column = 0; column < 4; ++column) {
      double sum = 0;
      for (k = 0; k < 4; ++k) {
        sum += at(camera->world_to_camera, row, k) * at(camera->local_to_world, k, column);
      }
      out[row][column] = camera_sign[row] * sum * scene_sign[column];
    }
  }
}

/* Returns the common length of the three rows; 0 if they differ by more than a thousandth. */
static double common_length(double rows[3][4]) {
  double lengths[3];
  int row;
  for (row = 0; row < 3; ++row) {
    lengths[row] = sqrt(rows[row][0] * rows[row][0] + rows[row][1] * rows[row][1] +
                        rows[row][2] * rows[row][2]);
  }
  for (row = 1; row < 3; ++row) {
    if (!(fabs(lengths[row] - lengths[0]) <= 1e-3 * lengths[0])) return 0;
  }
  return lengths[0] > 0 && lengths[0] < HUGE_VAL ? lengths[0] : 0;
}

/* Orthonormalises the first two rows of a rotation: products of Unity matrices are only roughly
 * orthonormal. */
static void orthonormalise(double rows[3][4]) {
  double along = 0, length = 0;
  int k;
  for (k = 0; k < 3; ++k) {
    along += rows[0][k] * rows[1][k];
    length += rows[0][k] * rows[0][k];
  }
  for (k = 0; k < 3; ++k) rows[1][k] -= along / length * rows[0][k];
  length = sqrt(rows[1][0] * rows[1][0] + rows[1][1] * rows[1][1] + rows[1][2] * rows[1][2]);
  for (k = 0; k < 3; ++k) rows[1][k] /= length;
}

int stgs_unity_view(const stgs_unity_camera* camera, stgs_view* view, float* unit) {
  const float* p = camera->projection;
  double rows[3][4], scale, cross[3];
  int row, k;
  if (!isfinite(camera->fovea_x) || !isfinite(camera->fovea_y)) return 0;
  if (!isfinite(camera->fovea_radius) || camera->fovea_radius < 0) return 0;
  if (!is_affine(camera->world_to_camera) || !is_affine(camera->local_to_world)) return 0;
  /* A perspective projection divides by -z and has no shear. */
  if (at(p, 3, 2) != -1 || at(p, 3, 3) != 0 || at(p, 0, 1) != 0 || at(p, 1, 0) != 0) return 0;
  scene_to_camera(camera, rows);
  scale = common_length(rows);
  if (scale == 0) return 0;
  for (row = 0; row < 3; ++row) {
    for (k = 0; k < 4; ++k) rows[row][k] /= scale;
  }
  orthonormalise(rows);
  /* The third row of a rotation is the cross product of the others; a negated third row means a
   * reflection. */
  for (k = 0; k < 3; ++k) {
    cross[k] =
        rows[0][(k + 1) % 3] * rows[1][(k + 2) % 3] - rows[0][(k + 2) % 3] * rows[1][(k + 1) % 3];
  }
  if (cross[0] * rows[2][0] + cross[1] * rows[2][1] + cross[2] * rows[2][2] < 0.99) return 0;
  if (stgs_view_defaults(view, sizeof *view) != STGS_OK) return 0;
  for (k = 0; k < 3; ++k) {
    view->rotation[k] = (float)rows[0][k];
    view->rotation[3 + k] = (float)rows[1][k];
    view->rotation[6 + k] = (float)cross[k];
    view->translation[k] = (float)rows[k][3];
  }
  view->width = camera->width;
  view->height = camera->height;
  view->fx = (float)(at(p, 0, 0) * camera->width / 2);
  view->fy = (float)(at(p, 1, 1) * camera->height / 2);
  view->cx = (float)((1 - at(p, 0, 2)) * camera->width / 2);
  view->cy = (float)((1 + at(p, 1, 2)) * camera->height / 2);
  view->fovea_x = camera->fovea_x;
  view->fovea_y = (float)camera->height - camera->fovea_y;
  view->fovea_radius = camera->fovea_radius;
  /* The near plane n projects to z = -1: n (P22 - 1) = P23. */
  view->near_plane = (float)(at(p, 2, 3) / (at(p, 2, 2) - 1) / scale);
  *unit = (float)scale;
  return view->near_plane > 0;
}
