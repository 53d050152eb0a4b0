// SPDX-License-Identifier: Apache-2.0
#include "init/far_content.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace stgs::encoder::init {
namespace {

constexpr int kWindow = 7;                // of a match, pixels
constexpr float kMinVariance = 12;        // of texture, grey levels^2
constexpr float kMinCorrelation = 0.85f;  // of a match
// Near textures match by chance, but in a window of this side most of them do not.
constexpr int kCoherence = 25;
constexpr double kMatchRatio = 1.5;
constexpr float kSameColour = 10;  // largest difference, grey levels
constexpr int kEdge = 20;          // range of the colours in 3 x 3 pixels, grey levels
constexpr int kMinSeeds = 49;      // pixels of an area
// Least share of an area without edges: of pixels that match; of far pixels, for all of it to be
// far; of pixels with colours of far content, likewise.
constexpr double kMatchShare = 0.03, kFarShare = 0.02, kFarColourShare = 0.8;
constexpr int kMinColour = 8;    // far pixels of a colour
constexpr int kColourRatio = 4;  // of the numbers of far and near pixels of a colour

// Compares each pixel of a view with the pixel of another view in the same direction.
struct Comparison {
  cv::Mat correlation;  // CV_32F, -1..1; 0 without texture
  cv::Mat difference;   // CV_32F, of the colours, grey levels
  cv::Mat visible;      // 8-bit, 255 where the other view has no confirmed surface in front
};

// Maps pixel indices of `view` to those of `other`, for content at infinity.
cv::Matx33d rotation_between(const View& view, const View& other) {
  const cv::Matx33d k_other(other.fx, 0, other.cx - 0.5, 0, other.fy, other.cy - 0.5, 0, 0, 1);
  const cv::Matx33d k_inverse(1 / view.fx, 0, (0.5 - view.cx) / view.fx, 0, 1 / view.fy,
                              (0.5 - view.cy) / view.fy, 0, 0, 1);
  return k_other * other.rotation * view.rotation.t() * k_inverse;
}

cv::Mat mean_of(const cv::Mat& image, int side = kWindow) {
  cv::Mat out;
  cv::blur(image, out, {side, side});
  return out;
}

cv::Mat correlation_of(const cv::Mat& a, const cv::Mat& b) {
  const cv::Mat mean_a = mean_of(a), mean_b = mean_of(b);
  const cv::Mat variance_a = mean_of(a.mul(a)) - mean_a.mul(mean_a);
  const cv::Mat variance_b = mean_of(b.mul(b)) - mean_b.mul(mean_b);
  const cv::Mat covariance = mean_of(a.mul(b)) - mean_a.mul(mean_b);
  cv::Mat spread, out;
  cv::sqrt(cv::max(variance_a.mul(variance_b), 1e-6), spread);
  cv::divide(covariance, spread, out);
  out.setTo(0, (variance_a < kMinVariance) | (variance_b < kMinVariance));
  return out;
}

Comparison compare(const Surface& surface, const Surface& other, const cv::Mat& other_usable) {
  const cv::Matx33d h = rotation_between(surface.view, other.view);
  const cv::Size size = surface.view.size();
  const auto warp = [&](const cv::Mat& image, int filter) {
    cv::Mat out;
    cv::warpPerspective(image, out, h, size, filter | cv::WARP_INVERSE_MAP, cv::BORDER_CONSTANT, 0);
    return out;
  };
  cv::Mat open = other_usable & (other.weight <= 0), grey, grey_there, difference;
  const cv::Mat there = warp(other.rgb, cv::INTER_LINEAR);
  cv::cvtColor(surface.rgb, grey, cv::COLOR_RGB2GRAY);
  cv::cvtColor(there, grey_there, cv::COLOR_RGB2GRAY);
  grey.convertTo(grey, CV_32F);
  grey_there.convertTo(grey_there, CV_32F);
  cv::Mat a, b;
  cv::blur(surface.rgb, a, {3, 3});
  cv::blur(there, b, {3, 3});
  cv::absdiff(a, b, difference);
  cv::transform(difference, difference, cv::Matx13f(1 / 3.0f, 1 / 3.0f, 1 / 3.0f));
  difference.convertTo(difference, CV_32F);
  // The map also has positions for directions behind the other view.
  cv::Mat visible = warp(open, cv::INTER_NEAREST);
  const cv::Vec3d axis = surface.view.rotation * other.view.forward();
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      const cv::Vec3d ray((x + 0.5 - surface.view.cx) / surface.view.fx,
                          (y + 0.5 - surface.view.cy) / surface.view.fy, 1);
      if (ray.dot(axis) <= 0) visible.at<std::uint8_t>(y, x) = 0;
    }
  }
  return {correlation_of(grey, grey_there), difference, visible};
}

// Returns 255 where the image has no edge.
cv::Mat without_edges(const cv::Mat& rgb) {
  cv::Mat largest, least;
  cv::dilate(rgb, largest, cv::Mat());
  cv::erode(rgb, least, cv::Mat());
  cv::Mat range = largest - least, channels[3];
  cv::split(range, channels);
  return cv::max(cv::max(channels[0], channels[1]), channels[2]) < kEdge;
}

// Keeps the connected areas of which enough pixels, and at least `share`, are seeds.
cv::Mat areas_with_seeds(const cv::Mat& areas, const cv::Mat& seeds, double share) {
  cv::Mat labels, stats, centroids, out(areas.size(), CV_8U, cv::Scalar(0));
  const int count = cv::connectedComponentsWithStats(areas, labels, stats, centroids, 4);
  std::vector<int> found(std::size_t(count), 0);
  for (int y = 0; y < labels.rows; ++y) {
    for (int x = 0; x < labels.cols; ++x) {
      if (seeds.at<std::uint8_t>(y, x)) ++found[std::size_t(labels.at<int>(y, x))];
    }
  }
  for (int k = 1; k < count; ++k) {
    const int area = stats.at<int>(k, cv::CC_STAT_AREA);
    if (found[std::size_t(k)] >= std::max(kMinSeeds, int(share * area)))
      out.setTo(255, labels == k);
  }
  return out;
}

// Returns 255 where a view shows far content, by comparison with others.
cv::Mat far_of(const std::vector<Surface>& surfaces, const std::vector<cv::Mat>& usable, int i,
               const std::vector<int>& others) {
  const Surface& surface = surfaces[i];
  const cv::Mat open = usable[i] & (surface.weight <= 0);
  cv::Mat agrees(surface.view.size(), CV_8U, cv::Scalar(0));
  cv::Mat votes(surface.view.size(), CV_16S, cv::Scalar(0)), voted = agrees.clone();
  for (const int j : others) {
    const Comparison found = compare(surface, surfaces[j], usable[j]);
    const cv::Mat same = open & found.visible & (found.difference < kSameColour);
    const cv::Mat textured = open & found.visible & (found.correlation != 0);
    const cv::Mat matches = same & (found.correlation > kMinCorrelation);
    cv::add(votes, 1, votes, matches);
    cv::subtract(votes, 1, votes, textured & ~matches);
    agrees |= same;
    voted |= matches;
  }
  cv::Mat matches = voted & (votes >= 0);
  matches &= mean_of(matches, kCoherence) > kMatchRatio * mean_of(votes < 0, kCoherence);
  const cv::Mat even = open & without_edges(surface.rgb);
  const cv::Mat far = areas_with_seeds(matches | (even & agrees), matches, kMatchShare);
  return areas_with_seeds(far | even, far, kFarShare);
}

// Counts of the colours of far and of confirmed near pixels in all views.
class Colours {
 public:
  void add(const Surface& surface, const cv::Mat& far) {
    for (int y = 0; y < far.rows; ++y) {
      for (int x = 0; x < far.cols; ++x) {
        const std::size_t at = bin(surface.rgb.at<cv::Vec3b>(y, x));
        if (far.at<std::uint8_t>(y, x) != 0) {
          ++far_[at];
        } else if (surface.weight.at<float>(y, x) > 0) {
          ++near_[at];
        }
      }
    }
  }
  // Returns 255 where a pixel has a colour of far content.
  cv::Mat far_pixels(const Surface& surface) const {
    cv::Mat out(surface.rgb.size(), CV_8U, cv::Scalar(0));
    for (int y = 0; y < out.rows; ++y) {
      for (int x = 0; x < out.cols; ++x) {
        const std::size_t at = bin(surface.rgb.at<cv::Vec3b>(y, x));
        if (far_[at] >= kMinColour && far_[at] > kColourRatio * near_[at])
          out.at<std::uint8_t>(y, x) = 255;
      }
    }
    return out;
  }

 private:
  static std::size_t bin(const cv::Vec3b& c) {
    return (std::size_t(c[0]) >> 4) << 8 | (std::size_t(c[1]) >> 4) << 4 | std::size_t(c[2]) >> 4;
  }
  std::vector<int> far_ = std::vector<int>(4096, 0), near_ = std::vector<int>(4096, 0);
};

Result<std::vector<cv::Mat>> find_far(const std::vector<Surface>& surfaces,
                                      const std::vector<cv::Mat>& usable, const cv::Vec3d& focus,
                                      Work& work) {
  std::vector<View> views;
  for (const Surface& surface : surfaces) views.push_back(surface.view);
  std::vector<cv::Mat> far(surfaces.size());
  STGS_TRY(work.for_each(int(surfaces.size()), [&](int i) -> Status {
    far[i] = far_of(surfaces, usable, i, neighbours(views, i, focus, 3 * kNeighbours));
    return {};
  }));
  Colours colours;
  for (std::size_t i = 0; i < far.size(); ++i) colours.add(surfaces[i], far[i]);
  for (std::size_t i = 0; i < far.size(); ++i) {
    const cv::Mat even = usable[i] & (surfaces[i].weight <= 0) & without_edges(surfaces[i].rgb);
    far[i] |= areas_with_seeds(even, even & colours.far_pixels(surfaces[i]), kFarColourShare);
  }
  return far;
}

}  // namespace

Result<bool> place_far_content(const std::vector<cv::Mat>& usable, const cv::Vec3d& focus,
                               double distance, float weight, Work& work,
                               std::vector<Surface>* surfaces) {
  STGS_ASSIGN(const std::vector<cv::Mat> far, find_far(*surfaces, usable, focus, work));
  double pixels = 0, found = 0;
  for (std::size_t i = 0; i < far.size(); ++i) {
    Surface& surface = (*surfaces)[i];
    pixels += double(far[i].total());
    found += cv::countNonZero(far[i]);
    for (int y = 0; y < far[i].rows; ++y) {
      for (int x = 0; x < far[i].cols; ++x) {
        if (!far[i].at<std::uint8_t>(y, x)) continue;
        const cv::Vec3d ray = surface.view.ray(x + 0.5, y + 0.5);
        const double length = cv::norm(ray);
        surface.depth.at<float>(y, x) = float(distance / length);
        surface.weight.at<float>(y, x) = weight;
        surface.normal.at<cv::Vec3f>(y, x) = cv::Vec3f(ray * (-1 / length));
      }
    }
  }
  if (found == 0) return false;
  work.log(fmt::format("far background: {:.0f} % of the pixels", 100 * found / pixels));
  return true;
}

}  // namespace stgs::encoder::init
