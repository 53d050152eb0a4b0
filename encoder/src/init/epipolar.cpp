// SPDX-License-Identifier: Apache-2.0
#include "init/epipolar.h"

#include <algorithm>
#include <cmath>

namespace stgs::encoder::init {

cv::Matx33d fundamental_of(const View& a, const View& b) {
  const cv::Matx33d rotation = b.rotation * a.rotation.t();
  cv::Vec3d t = b.translation - rotation * a.translation;
  t /= std::max(cv::norm(t), 1e-300);
  const cv::Matx33d cross(0, -t[2], t[1], t[2], 0, -t[0], -t[1], t[0], 0);
  const auto inverse = [](const View& v) {
    return cv::Matx33d(1 / v.fx, 0, -v.cx / v.fx, 0, 1 / v.fy, -v.cy / v.fy, 0, 0, 1);
  };
  return inverse(b).t() * cross * rotation * inverse(a);
}

double epipolar_offset(const cv::Matx33d& f, const cv::Point2d& p, const cv::Point2d& q) {
  const cv::Vec3d x(p.x, p.y, 1), y(q.x, q.y, 1);
  const cv::Vec3d line = f * x, other = f.t() * y;
  const double square =
      line[0] * line[0] + line[1] * line[1] + other[0] * other[0] + other[1] * other[1];
  return y.dot(line) / std::sqrt(std::max(square, 1e-300));
}

double epipolar_distance(const cv::Matx33d& f, const cv::Point2d& p, const cv::Point2d& q) {
  return std::abs(epipolar_offset(f, p, q));
}

}  // namespace stgs::encoder::init
