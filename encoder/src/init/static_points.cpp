// SPDX-License-Identifier: Apache-2.0
#include "init/static_points.h"

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "init/carved_depth.h"
#include "init/far_content.h"
#include "init/stereo_depth.h"
#include "stgs/format/parallel.h"

namespace stgs::encoder::init {
namespace {

constexpr int kCoarseMaxSide = 128;  // longer side of the coarse sweep, pixels
constexpr int kCoarsePlanes = 64;
constexpr double kAgreeSteps = 1.5;  // largest disagreement of two views, in planes
constexpr float kMaxCost = 0.6f;
// Depth of the farthest content relative to that of the focus. Beyond it, content moves between
// cameras 30 degrees apart by less than a hundredth of the width of their images.
constexpr double kFarDepths = 40;
constexpr int kDepthMaxSide = 320;  // longer side of the images of depth maps, pixels

// Returns the median distance of a view to its nearest neighbour.
double median_baseline(const std::vector<View>& views) {
  std::vector<double> distances;
  for (std::size_t i = 0; i < views.size(); ++i) {
    double nearest = 1e300;
    for (std::size_t j = 0; j < views.size(); ++j) {
      const double d = cv::norm(views[i].centre - views[j].centre);
      if (i != j && d > 1e-9) nearest = std::min(nearest, d);
    }
    if (nearest < 1e300) distances.push_back(nearest);
  }
  if (distances.empty()) return 0;
  std::nth_element(distances.begin(), distances.begin() + distances.size() / 2, distances.end());
  return distances[distances.size() / 2];
}

// Returns the measurable depth range: disparities from half the image width down to half a pixel.
DepthRange widest_range(const std::vector<View>& views, const Focus& focus) {
  const double baseline = median_baseline(views);
  const View& view = views[0];
  DepthRange range;
  range.nearest = view.fx * baseline / (0.5 * view.width);
  range.farthest = view.fx * baseline / 0.5;
  if (focus.depth > 0) {
    range.nearest = std::min(range.nearest, 0.25 * focus.depth);
    range.farthest = std::min(std::max(range.farthest, 3 * focus.depth), kFarDepths * focus.depth);
  }
  if (baseline <= 0) range.nearest = 1, range.farthest = 10;
  return range;
}

int needed_agreement(std::size_t views) {
  return views >= 5 ? 2 : 1;
}

struct SweepPlan {
  Focus focus;
  DepthRange range;
  int max_side = 0;                     // longer side of the images, pixels
  int low_planes = 0, high_planes = 0;  // see plane_count()
};

// The depth maps of several views, with the images that they were computed from.
struct Sweeps {
  std::vector<SweepImage> images;
  std::vector<DepthMap> maps;
  std::vector<double> steps;  // of inverse depth, from plane to plane
};

std::vector<View> views_of(const std::vector<SweepImage>& images) {
  std::vector<View> views;
  views.reserve(images.size());
  for (const SweepImage& image : images) views.push_back(image.view);
  return views;
}

// Computes the depth maps of all inputs, each against its neighbours.
Status sweep_all(const std::vector<StaticImage>& inputs, const SweepPlan& plan,
                 geometry::ViewSweeper* gpu, Work& work, Sweeps* out) {
  out->images.resize(inputs.size());
  parallel_for(std::size_t{0}, inputs.size(), [&](std::size_t i) {
    const StaticImage& input = inputs[i];
    out->images[i] =
        make_sweep_image(make_view(*input.view.camera, plan.max_side), input.rgb, input.usable);
  });
  const std::vector<View> views = views_of(out->images);
  std::vector<WantedDepth> wanted(inputs.size());
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    const std::vector<int> near = neighbours(views, int(i), plan.focus.point, kNeighbours);
    const int planes = plane_count(views[i], views, near, plan.range.nearest, plan.range.farthest,
                                   plan.low_planes, plan.high_planes);
    wanted[i] = {int(i), near, {plan.range.nearest, plan.range.farthest, planes}};
    out->steps.push_back(plane_step(wanted[i].planes));
  }
  return sweep_views(out->images, wanted, gpu, work, &out->maps);
}

// Returns a weight that is above 0 where enough other views agree with the depth.
cv::Mat check_across(const Sweeps& sweeps, int i, const cv::Vec3d& focus) {
  const std::vector<SweepImage>& images = sweeps.images;
  const std::vector<DepthMap>& maps = sweeps.maps;
  const std::vector<View> views = views_of(images);
  std::vector<std::pair<const View*, const DepthMap*>> others;
  for (const int j : neighbours(views, i, focus, 3 * kNeighbours)) {
    others.emplace_back(&images[j].view, &maps[j]);
  }
  const int needed = needed_agreement(images.size());
  cv::Mat weight(views[i].size(), CV_32F, cv::Scalar(0));
  for (int y = 0; y < weight.rows; ++y) {
    for (int x = 0; x < weight.cols; ++x) {
      const float cost = maps[i].cost.at<float>(y, x);
      if (cost > kMaxCost || !images[i].usable.at<std::uint8_t>(y, x)) continue;
      const int agree = agreement(views[i], maps[i], x, y, others, kAgreeSteps * sweeps.steps[i]);
      if (agree >= needed) weight.at<float>(y, x) = 1.05f - cost + 0.1f * float(agree - needed);
    }
  }
  return weight;
}

// Returns the inverse depths that other views confirm.
std::vector<float> confirmed_depths(const Sweeps& sweeps, const cv::Vec3d& focus) {
  std::vector<std::vector<float>> found(sweeps.maps.size());
  parallel_for(std::size_t{0}, found.size(), [&](std::size_t i) {
    const cv::Mat weight = check_across(sweeps, int(i), focus);
    for (int y = 0; y < weight.rows; ++y) {
      for (int x = 0; x < weight.cols; ++x) {
        if (weight.at<float>(y, x) > 0.7f)
          found[i].push_back(1 / sweeps.maps[i].depth.at<float>(y, x));
      }
    }
  });
  std::vector<float> all;
  for (const std::vector<float>& part : found) all.insert(all.end(), part.begin(), part.end());
  return all;
}

// Clears the weight of small islands of depth, because views agree by chance on uniform surfaces.
void drop_islands(const DepthMap& map, double nearest, double step, cv::Mat* weight) {
  cv::Mat level(weight->size(), CV_16S, cv::Scalar(0));
  const double unit = std::max(step / 16, 1 / nearest / 30000);  // of inverse depth
  for (int y = 0; y < level.rows; ++y) {
    for (int x = 0; x < level.cols; ++x) {
      const float depth = map.depth.at<float>(y, x);
      if (weight->at<float>(y, x) <= 0 || depth <= 0) continue;
      level.at<short>(y, x) = short(std::clamp(1 / (depth * unit), 1.0, 32000.0));
    }
  }
  const int smallest = std::max(6, int(level.total() / 1200));
  cv::filterSpeckles(level, 0, smallest, std::max(1.0, 2 * step / unit));
  weight->setTo(0, level == 0);
}

// Interpolates inverse depth where the weight is 0, from confirmed values in an image pyramid.
cv::Mat fill_depth(const cv::Mat& depth, const cv::Mat& weight, double fallback) {
  const cv::Mat known = weight > 0;
  cv::Mat inverse(depth.size(), CV_32F, cv::Scalar(0)), mass(depth.size(), CV_32F, cv::Scalar(0));
  mass.setTo(1, known);
  for (int y = 0; y < depth.rows; ++y) {
    for (int x = 0; x < depth.cols; ++x) {
      if (known.at<std::uint8_t>(y, x)) inverse.at<float>(y, x) = 1 / depth.at<float>(y, x);
    }
  }
  std::vector<cv::Mat> values{inverse}, masses{mass};
  while (std::max(values.back().rows, values.back().cols) > 1) {
    const cv::Size half((values.back().cols + 1) / 2, (values.back().rows + 1) / 2);
    cv::Mat v, m;
    cv::resize(values.back(), v, half, 0, 0, cv::INTER_AREA);
    cv::resize(masses.back(), m, half, 0, 0, cv::INTER_AREA);
    values.push_back(v);
    masses.push_back(m);
  }
  cv::Mat filled(values.back().size(), CV_32F, cv::Scalar(1 / fallback));
  for (int level = int(values.size()) - 1; level >= 0; --level) {
    if (filled.size() != values[level].size()) {
      cv::resize(filled, filled, values[level].size(), 0, 0, cv::INTER_LINEAR);
    }
    for (int y = 0; y < filled.rows; ++y) {
      for (int x = 0; x < filled.cols; ++x) {
        const float m = masses[level].at<float>(y, x);
        if (m <= 0) continue;
        const float trust = std::min(1.0f, 4 * m);
        float& f = filled.at<float>(y, x);
        f = trust * values[level].at<float>(y, x) / m + (1 - trust) * f;
      }
    }
  }
  cv::Mat out;
  cv::divide(1.0, filled, out);
  depth.copyTo(out, known);
  return out;
}

// Returns a range around the depths of most pixels. Sweeps of sparse rigs have outliers, which
// stereo would find again if the range included them.
DepthRange surface_range(const std::vector<Surface>& surfaces) {
  std::vector<float> depths;
  for (const Surface& surface : surfaces)
    depths.insert(depths.end(), surface.depth.begin<float>(), surface.depth.end<float>());
  const auto quantile = [&depths](double q) {
    const auto at = depths.begin() + std::ptrdiff_t(q * double(depths.size() - 1));
    std::nth_element(depths.begin(), at, depths.end());
    return double(*at);
  };
  return {0.5 * quantile(0.01), 2 * quantile(0.99), true};
}

// Replaces swept depth where stereo has confirmed another.
void prefer_stereo(const StereoDepth& stereo, const cv::Mat& usable, Surface* surface) {
  const auto scaled = [size = surface->weight.size()](const cv::Mat& map) {
    cv::Mat out;
    cv::resize(map, out, size, 0, 0, cv::INTER_NEAREST);
    return out;
  };
  const cv::Mat depth = scaled(stereo.depth);
  const cv::Mat confirmed = (depth > 0) & usable;
  depth.copyTo(surface->depth, confirmed);
  const cv::Mat weight = kStereoWeight + 1 - scaled(stereo.cost);
  weight.copyTo(surface->weight, confirmed);
  surface->normal = cv::Mat(surface->weight.size(), CV_32FC3, cv::Scalar(0));
  scaled(stereo.normal).copyTo(surface->normal, confirmed);
}

// Removes the points from `first` on that lie in front of depth that stereo confirms.
void drop_contradicted(const std::vector<Surface>& surfaces, std::size_t first,
                       std::vector<SurfacePoint>* points) {
  const auto contradicted = [&surfaces](const SurfacePoint& point) {
    return is_contradicted(surfaces, point.position);
  };
  points->erase(
      std::remove_if(points->begin() + std::ptrdiff_t(first), points->end(), contradicted),
      points->end());
}

}  // namespace

int plane_count(const View& view, const std::vector<View>& views, const std::vector<int>& others,
                double nearest, double farthest, int low, int high) {
  double widest = 0;
  for (const int j : others) {
    const cv::Vec3d step = view.rotation * (views[j].centre - view.centre);
    widest = std::max(widest, std::hypot(step[0], step[1]) * view.fx);
  }
  return std::clamp(int(std::ceil(widest * (1 / nearest - 1 / farthest))), low, high);
}

Status find_depth_range(const std::vector<std::vector<StaticImage>>& inputs,
                        geometry::ViewSweeper* gpu, Work& work, StaticScene* scene) {
  std::vector<View> views;
  for (const StaticImage& input : inputs[0]) {
    views.push_back(make_view(*input.view.camera, kCoarseMaxSide));
  }
  scene->focus = find_focus(views);
  const DepthRange wide = widest_range(views, scene->focus);
  scene->range = wide;
  if (scene->focus.depth <= 0) {
    // Without a common focus, uses a point in front of the mean camera position.
    cv::Vec3d forward(0, 0, 0);
    for (const View& view : views) forward += view.forward();
    const double depth = std::sqrt(wide.nearest * wide.farthest);
    scene->focus.point += depth * cv::normalize(forward);
    scene->focus.depth = depth;
  }
  if (views.size() < 2) return {};
  std::vector<float> inverse;
  for (const std::vector<StaticImage>& group : inputs) {
    Sweeps sweeps;
    STGS_TRY(sweep_all(group, {scene->focus, wide, kCoarseMaxSide, kCoarsePlanes, kCoarsePlanes},
                       gpu, work, &sweeps));
    const std::vector<float> found = confirmed_depths(sweeps, scene->focus.point);
    inverse.insert(inverse.end(), found.begin(), found.end());
  }
  if (inverse.size() < 50 * views.size()) return {};
  std::sort(inverse.begin(), inverse.end());
  const auto share = [&](double q) { return inverse[std::size_t(q * double(inverse.size() - 1))]; };
  scene->range.farthest = std::min(wide.farthest, 1.25 / share(0.005));
  scene->range.nearest = std::max(wide.nearest, 0.8 / share(0.995));
  scene->range.measured = true;
  return {};
}

Status find_static_depth(const std::vector<StaticImage>& inputs, geometry::ViewSweeper* gpu,
                         Work& work, StaticScene* scene) {
  int max_side = 0;
  for (const StaticImage& input : inputs) {
    max_side = std::max({max_side, input.view.width, input.view.height});
  }
  Sweeps sweeps;
  max_side = std::min(kDepthMaxSide, max_side);
  STGS_TRY(sweep_all(inputs, {scene->focus, scene->range, max_side, 32, 96}, gpu, work, &sweeps));
  scene->surfaces.resize(inputs.size());
  scene->usable.resize(inputs.size());
  return work.for_each(int(inputs.size()), [&](int i) -> Status {
    Surface& surface = scene->surfaces[i];
    surface.view = sweeps.images[i].view;
    surface.rgb = sweeps.images[i].rgb;
    scene->usable[i] = sweeps.images[i].usable;
    surface.weight = check_across(sweeps, i, scene->focus.point);
    drop_islands(sweeps.maps[i], scene->range.nearest, sweeps.steps[i], &surface.weight);
    surface.depth = fill_depth(sweeps.maps[i].depth, surface.weight, 0.7 * scene->range.farthest);
    return {};
  });
}

Status refine_static_depth(const std::vector<StaticImage>& inputs, const StereoChoice& choice,
                           Work& work, StaticScene* scene) {
  const DepthRange range = surface_range(scene->surfaces);
  STGS_ASSIGN(const std::vector<StereoDepth> stereo,
              match_static(inputs, scene->focus.point, range, choice, work));
  if (stereo.empty()) return {};
  for (std::size_t i = 0; i < stereo.size(); ++i) {
    Surface& surface = scene->surfaces[i];
    prefer_stereo(stereo[i], scene->usable[i], &surface);
  }
  work.stage("far background", 2);
  const double far_distance = kFarDepths * scene->focus.depth;
  STGS_ASSIGN(const bool is_far, place_far_content(scene->usable, scene->focus.point, far_distance,
                                                   kStereoWeight, work, &scene->surfaces));
  if (is_far) scene->far = far_distance;
  for (Surface& surface : scene->surfaces) {
    surface.depth = fill_depth(surface.depth, surface.weight, 0.7 * scene->range.farthest);
  }
  return carve_depth(scene->range.nearest, scene->range.farthest, work, &scene->surfaces);
}

void choose_static_points(const std::vector<SurfacePoint>& given, int limit, StaticScene* scene) {
  const double tolerance = 0.03 * (1 / scene->range.nearest - 1 / scene->range.farthest);
  scene->points = given;
  if (const int kept = limit / 2; int(scene->points.size()) > kept) {
    // Thins evenly, to reserve points for other surfaces.
    std::vector<SurfacePoint> thinned;
    thinned.reserve(kept);
    const double stride = double(given.size()) / kept;
    for (int i = 0; i < kept; ++i) thinned.push_back(given[std::size_t(i * stride)]);
    scene->points = thinned;
  }
  scene->given = int(scene->points.size());
  // Reserves a fifth of the limit for unmeasured surfaces.
  const int block = cover_within(scene->surfaces, limit * 4 / 5, tolerance, &scene->points);
  drop_contradicted(scene->surfaces, std::size_t(scene->given), &scene->points);
  scene->swept = int(scene->points.size()) - scene->given;
  std::vector<Surface> holes = scene->surfaces;
  for (std::size_t i = 0; i < holes.size(); ++i) {
    holes[i].weight = cv::Mat();  // that of the surface must not change
    scene->usable[i].convertTo(holes[i].weight, CV_32F);
  }
  for (int wide = std::max(4, block);; wide = wide * 5 / 4 + 1) {
    std::vector<SurfacePoint> all = scene->points;
    cover(holes, wide, tolerance, &all);
    drop_contradicted(scene->surfaces, scene->points.size(), &all);
    if (int(all.size()) > limit && wide < 4096) continue;
    scene->filled = int(all.size() - scene->points.size());
    scene->points = std::move(all);
    return;
  }
}

Result<std::vector<SurfacePoint>> given_points(const PreparedCapture& capture,
                                               const std::vector<View>& views,
                                               const std::vector<InitialPoint>& points,
                                               bool separate_motion) {
  std::vector<SurfacePoint> out;
  std::vector<cv::Mat> masks(views.size());
  for (std::size_t i = 0; separate_motion && i < views.size(); ++i) {
    STGS_ASSIGN(masks[i], load_mask_image(capture, views[i], 0));
  }
  for (const InitialPoint& point : points) {
    const cv::Vec3d position = position_of(point);
    int visible = 0, dynamic = 0;
    for (std::size_t i = 0; i < views.size(); ++i) {
      const Pixel p = project(views[i], position);
      if (!p.inside) continue;
      ++visible;
      dynamic += !masks[i].empty() && masks[i].at<std::uint8_t>(p.y(), p.x()) ? 1 : 0;
    }
    if (visible == 0 || 2 * dynamic > visible) continue;
    out.push_back({position, {point.colour[0], point.colour[1], point.colour[2]}});
  }
  return out;
}

}  // namespace stgs::encoder::init
