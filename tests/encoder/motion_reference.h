// SPDX-License-Identifier: Apache-2.0
// Moving textures with known flow, and flow by geometry/flow_rule.h on the CPU.
#pragma once

#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "geometry/flow_rule.h"

namespace stgs::testing {

// The levels of a grey image, and their gradients.
struct GreyPyramid {
  std::vector<cv::Mat> grey;  // CV_32F
  std::vector<std::vector<encoder::geometry::Vec2>> gradients;

  explicit GreyPyramid(const cv::Mat& rgb) {
    namespace geometry = encoder::geometry;
    grey.emplace_back();
    cv::cvtColor(rgb, grey[0], cv::COLOR_RGB2GRAY);
    grey[0].convertTo(grey[0], CV_32F);
    for (int l = 0; l < geometry::coarsest_flow_level(rgb.cols, rgb.rows); ++l) {
      cv::Mat half(grey[l].rows / 2, grey[l].cols / 2, CV_32F);
      for (int y = 0; y < half.rows; ++y)
        for (int x = 0; x < half.cols; ++x)
          half.at<float>(y, x) = geometry::half_size_grey(grey[l].ptr<float>(), grey[l].cols, x, y);
      grey.push_back(half);
    }
    for (const cv::Mat& level : grey) {
      gradients.emplace_back();
      for (int y = 0; y < level.rows; ++y)
        for (int x = 0; x < level.cols; ++x)
          gradients.back().push_back(
              geometry::grey_gradient(level.ptr<float>(), level.cols, level.rows, x, y));
    }
  }
  encoder::geometry::FlowLevel level(int l) const {
    return {grey[l].ptr<float>(), gradients[l].data(), grey[l].cols, grey[l].rows};
  }
};

// A field of flow that owns its memory.
struct OwnedField {
  std::vector<encoder::geometry::Vec2> flow;
  int width = 0, height = 0;
  encoder::geometry::FlowField view() const {
    return {flow.empty() ? nullptr : flow.data(), width, height};
  }
};

inline OwnedField level_flow(const GreyPyramid& a, const GreyPyramid& b, int l,
                             const OwnedField& coarser) {
  namespace geometry = encoder::geometry;
  const geometry::FlowLevel from = a.level(l);
  const float* const to = b.grey[l].ptr<float>();
  const int columns = geometry::patches_along(from.width);
  const int rows = geometry::patches_along(from.height);
  std::vector<geometry::PatchFlow> patches;
  for (int j = 0; j < rows; ++j)
    for (int i = 0; i < columns; ++i)
      patches.push_back(geometry::first_patch_flow(from, to, coarser.view(), i, j));
  for (int k = 1; k < geometry::kFlowRounds; ++k) {
    const std::vector<geometry::PatchFlow> before = patches;
    for (int p = 0; p < columns * rows; ++p)
      patches[p] = geometry::next_patch_flow(from, to, {before.data(), columns, rows}, p % columns,
                                             p / columns);
  }
  OwnedField out{{}, from.width, from.height};
  for (int y = 0; y < from.height; ++y)
    for (int x = 0; x < from.width; ++x)
      out.flow.push_back(geometry::dense_flow(from, to, {patches.data(), columns, rows}, x, y));
  return out;
}

// The flow of the finest level.
inline OwnedField rule_field(const GreyPyramid& a, const GreyPyramid& b) {
  namespace geometry = encoder::geometry;
  const int width = a.grey[0].cols, height = a.grey[0].rows;
  OwnedField out;
  for (int l = geometry::coarsest_flow_level(width, height);
       l >= geometry::finest_flow_level(width, height); --l)
    out = level_flow(a, b, l, out);
  return out;
}

// The flow of all pixels between RGB images, CV_32FC2; with `checked`, NaN where the flow back
// disagrees.
inline cv::Mat rule_flow(const cv::Mat& a, const cv::Mat& b, bool checked) {
  namespace geometry = encoder::geometry;
  cv::Mat out(a.size(), CV_32FC2, cv::Scalar::all(NAN));
  if (std::min(a.cols, a.rows) < geometry::kMinFlowSide) return out;
  const GreyPyramid from(a), to(b);
  const OwnedField forward = rule_field(from, to);
  const OwnedField back = checked ? rule_field(to, from) : OwnedField{};
  const int level = geometry::finest_flow_level(a.cols, a.rows);
  for (int y = 0; y < a.rows; ++y) {
    for (int x = 0; x < a.cols; ++x) {
      const geometry::Vec2 flow =
          checked ? geometry::checked_flow(forward.view(), back.view(), level, a.cols, a.rows, x, y)
                  : geometry::image_flow(forward.view(), level, x, y);
      out.at<cv::Vec2f>(y, x) = {flow.x, flow.y};
    }
  }
  return out;
}

}  // namespace stgs::testing
