// SPDX-License-Identifier: Apache-2.0
#include "init/static_findings.h"

#include <array>
#include <cmath>

#include "archive.h"

namespace stgs::encoder {
namespace {

// A thousand cameras with depth maps of 320x240 pixels, and 40 million points, take most of it.
constexpr std::uint64_t kMaxFileBytes = 1u << 31;
const ArchiveKind kFindings = {
    .magic = {'S', 'T', 'G', 'S', 'F', 'N', 'D', '1'},
    .noun = "analysis of the first window",
    .if_damaged = "remove it, and the next run analyses the window again",
    .if_other = "remove it, and the next run analyses the window again",
    .max_bytes = kMaxFileBytes};

using Vector = std::array<float, 3>;

// A point as a file has it: without velocity, and without the bytes between its members.
struct StoredPoint {
  Vector position{}, normal{};
  std::array<std::uint8_t, 4> colour{};
};
static_assert(sizeof(StoredPoint) == 28);

StoredPoint stored(const InitialPoint& point) {
  return {std::to_array(point.position),
          std::to_array(point.normal),
          {point.colour[0], point.colour[1], point.colour[2], 0}};
}

InitialPoint restored(const StoredPoint& from) {
  InitialPoint point{};
  std::copy_n(from.position.begin(), 3, point.position);
  std::copy_n(from.normal.begin(), 3, point.normal);
  std::copy_n(from.colour.begin(), 3, point.colour);
  point.frame = -1;
  return point;
}

// Visits the numbers in file order.
template <typename Findings, typename Archive>
void visit_numbers(Findings& findings, Archive& archive) {
  archive.value(findings.range.nearest);
  archive.value(findings.range.farthest);
  archive.value(findings.focus.point.val);
  archive.value(findings.focus.depth);
  archive.value(findings.bounds.near_plane);
  archive.value(findings.bounds.extent);
  archive.value(findings.bounds.scene_radius);
  archive.value(findings.bounds.scene_centre);
}

std::vector<float> values_of(const cv::Mat& map) {
  const cv::Mat values = map.isContinuous() ? map : map.clone();
  const auto* const first = values.ptr<float>();
  return {first, first + values.total()};
}

// Reads a map; empty if its size is not that of the bytes.
cv::Mat read_map(ArchiveReader& reader, std::int32_t rows, std::int32_t columns) {
  std::vector<float> values;
  reader.array(values);
  const bool fits =
      rows > 0 && columns > 0 &&
      values.size() == static_cast<std::size_t>(rows) * static_cast<std::size_t>(columns);
  return fits ? cv::Mat(rows, columns, CV_32F, values.data()).clone() : cv::Mat();
}

init::Surface read_surface(ArchiveReader& reader) {
  std::int32_t rows = 0, columns = 0;
  reader.value(rows);
  reader.value(columns);
  init::Surface surface;
  surface.depth = read_map(reader, rows, columns);
  surface.weight = read_map(reader, rows, columns);
  return surface;
}

// Returns whether later windows can use the numbers and maps.
bool are_usable(const StaticFindings& findings) {
  const PreparedCapture& bounds = findings.bounds;
  for (const double v : {findings.focus.point[0], findings.focus.point[1], findings.focus.point[2],
                         findings.focus.depth, bounds.scene_centre[0], bounds.scene_centre[1],
                         bounds.scene_centre[2]}) {
    if (!std::isfinite(v)) return false;
  }
  for (const init::Surface& surface : findings.surfaces)
    if (surface.depth.empty() || surface.weight.empty()) return false;
  const auto is_positive = [](double v) { return std::isfinite(v) && v > 0; };
  return is_positive(findings.range.nearest) && findings.range.farthest >= findings.range.nearest &&
         std::isfinite(findings.range.farthest) && is_positive(bounds.near_plane) &&
         is_positive(bounds.extent) && is_positive(bounds.scene_radius);
}

}  // namespace

Status write_findings(const std::string& path, const std::string& identity,
                      const StaticFindings& findings) {
  ArchiveWriter writer(kFindings);
  writer.array(identity);
  visit_numbers(findings, writer);
  writer.value(static_cast<std::uint32_t>(findings.agreeing.size()));
  for (std::size_t i = 0; i < findings.agreeing.size(); ++i) {
    const init::Surface& surface = findings.surfaces[i];
    writer.array(findings.agreeing[i]);
    writer.value(static_cast<std::int32_t>(surface.depth.rows));
    writer.value(static_cast<std::int32_t>(surface.depth.cols));
    writer.array(values_of(surface.depth));
    writer.array(values_of(surface.weight));
  }
  std::vector<StoredPoint> points;
  points.reserve(findings.points.size());
  for (const InitialPoint& point : findings.points) points.push_back(stored(point));
  writer.array(points);
  return writer.save(path);
}

Result<StaticFindings> read_findings(const std::string& path, const std::string& identity) {
  STGS_ASSIGN(ArchiveReader reader, ArchiveReader::open(path, kFindings));
  std::string found;
  reader.array(found);
  if (reader.ok() && found != identity) {
    return usage_error("{}: belongs to another capture or to other settings; remove it", path);
  }
  StaticFindings findings;
  visit_numbers(findings, reader);
  std::uint32_t cameras = 0;
  reader.value(cameras);
  for (std::uint32_t i = 0; i < cameras && reader.ok(); ++i) {
    reader.array(findings.agreeing.emplace_back());
    findings.surfaces.push_back(read_surface(reader));
  }
  std::vector<StoredPoint> points;
  reader.array(points);
  if (!reader.complete() || !are_usable(findings))
    return invalid_file("{}: damaged {}; {}", path, kFindings.noun, kFindings.if_damaged);
  findings.points.reserve(points.size());
  for (const StoredPoint& point : points) findings.points.push_back(restored(point));
  return findings;
}

}  // namespace stgs::encoder
