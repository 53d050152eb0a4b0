// SPDX-License-Identifier: Apache-2.0
// Images of a textured disc that moves over a textured wall.
#pragma once

#include <opencv2/imgproc.hpp>
#include <vector>

namespace stgs::testing {

inline constexpr int kTextureMargin = 64;  // pixels

inline cv::Mat noise_texture(cv::Size size, int seed, double contrast) {
  cv::RNG random(seed);
  cv::Mat out(size, CV_32FC3, cv::Scalar(130, 115, 125));
  for (int grain = 32; grain >= 4; grain /= 2) {
    cv::Mat coarse(size.height / grain + 2, size.width / grain + 2, CV_32FC3), fine;
    random.fill(coarse, cv::RNG::NORMAL, 0, contrast);
    cv::resize(coarse, fine, size, 0, 0, cv::INTER_CUBIC);
    out += fine;
    contrast *= 0.75;
  }
  return out;
}

struct MovingTexture {
  cv::Size size;
  cv::Vec2d velocity;  // of the disc, pixels per frame
  double noise = 1;    // grey levels
  cv::Mat wall, front;

  MovingTexture(cv::Size of, cv::Vec2d moves, double noisy)
      : size(of), velocity(moves), noise(noisy) {
    const cv::Size large(of.width + 2 * kTextureMargin, of.height + 2 * kTextureMargin);
    wall = noise_texture(large, 1, 14);
    front = noise_texture(large, 2, 22);
  }
  cv::Point2d centre(int frame) const {
    return {0.35 * size.width + frame * velocity[0], 0.45 * size.height + frame * velocity[1]};
  }
  double radius() const { return 0.22 * std::min(size.width, size.height); }
  bool is_disc(int frame, int x, int y) const {
    return cv::norm(cv::Point2d(x, y) - centre(frame)) < radius();
  }

  cv::Mat image(int frame) const {
    cv::Mat moved, out = wall(cv::Rect({kTextureMargin, kTextureMargin}, size)).clone();
    const double dx = frame * velocity[0], dy = frame * velocity[1];
    const cv::Matx23d shift(1, 0, dx - kTextureMargin, 0, 1, dy - kTextureMargin);
    cv::warpAffine(front, moved, shift, size, cv::INTER_CUBIC, cv::BORDER_REFLECT);
    for (int y = 0; y < size.height; ++y)
      for (int x = 0; x < size.width; ++x)
        if (is_disc(frame, x, y)) out.at<cv::Vec3f>(y, x) = moved.at<cv::Vec3f>(y, x);
    cv::RNG random(100 + frame);
    cv::Mat noisy(size, CV_32FC3);
    random.fill(noisy, cv::RNG::NORMAL, 0, noise);
    out += noisy;
    out.convertTo(out, CV_8U);
    return out;
  }
  std::vector<cv::Mat> images(int frames) const {
    std::vector<cv::Mat> out;
    for (int frame = 0; frame < frames; ++frame) out.push_back(image(frame));
    return out;
  }
  // The wall without noise.
  cv::Mat background() const {
    cv::Mat out;
    wall(cv::Rect({kTextureMargin, kTextureMargin}, size)).convertTo(out, CV_8U);
    return out;
  }
  // The mean distance of a flow from the ground truth in the first frame, pixels: of all pixels, or
  // of those of the disc.
  double error_of(const cv::Mat& flow, bool in_disc) const {
    double sum = 0;
    int count = 0;
    for (int y = 0; y < size.height; ++y) {
      for (int x = 0; x < size.width; ++x) {
        const bool moves = is_disc(0, x, y);
        if (in_disc && !moves) continue;
        const cv::Vec2f f = flow.at<cv::Vec2f>(y, x);
        sum += cv::norm(cv::Vec2d(f[0], f[1]) - (moves ? velocity : cv::Vec2d(0, 0)));
        ++count;
      }
    }
    return sum / count;
  }
};

}  // namespace stgs::testing
