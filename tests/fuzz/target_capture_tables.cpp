// SPDX-License-Identifier: Apache-2.0
// Binary tables of captures: initial points (PLY) and optical flow (.flo). The first byte of an
// input is the kind. NumPy tables are in the target capture_layouts.
#include "../fixtures/file_bytes.h"
#include "captures.h"
#include "init/motion.h"

using namespace stgs;
using namespace stgs::fuzz;
using namespace stgs::encoder;

namespace {

enum Kind : std::uint8_t { kPoints, kFlow, kKinds };

Bytes input_of(Kind kind, const std::string& content) {
  Bytes out = {kind};
  out.insert(out.end(), content.begin(), content.end());
  return out;
}

Bytes points_seed(int frame) {
  const std::string path = input_folder().beside("seed.ply");
  require(write_points(path, {{{1, 2, 3}, {4, 5, 6}, {0.5f, 0, 0}, frame},
                              {{-1, 0, 1e9f}, {0, 255, 1}, {0, 0, 0}, -1}})
              .ok(),
          "seeds can be written");
  const Bytes bytes = testing::bytes_of(path);
  return input_of(kPoints, {bytes.begin(), bytes.end()});
}

Bytes flow_seed(std::int32_t width, std::int32_t height) {
  std::string bytes;
  append_value(bytes, 202021.25f);
  append_value(bytes, width);
  append_value(bytes, height);
  for (int i = 0; i < 2 * width * height; ++i) append_value(bytes, 0.5f * static_cast<float>(i));
  return input_of(kFlow, bytes);
}

std::vector<Bytes> seeds() {
  return {points_seed(-1), points_seed(3), flow_seed(4, 3), flow_seed(1, 1)};
}

// The headers and the first rows.
std::vector<Unit> units(View input) {
  return {{0, std::min<std::size_t>(input.size(), 64)}, {0, input.size()}};
}

// Points are decoded to twice their bytes in a file, and written and read again.
std::uint64_t memory(View input) {
  return 32 * input.size() + (64 << 10);
}

bool is_same(const InitialPoint& a, const InitialPoint& b) {
  return std::equal(a.position, a.position + 3, b.position) &&
         std::equal(a.colour, a.colour + 3, b.colour) &&
         std::equal(a.velocity, a.velocity + 3, b.velocity);
}

void check_points(View content) {
  const auto points = read_points(*memory_source(Bytes(content.begin(), content.end()), "input"));
  check_error(points.status());
  if (!points.ok()) return;
  // Without a point that moves, velocities are not written.
  const bool moving = std::any_of(points->begin(), points->end(),
                                  [](const InitialPoint& point) { return point.frame >= 0; });
  const std::string path = input_folder().beside("again.ply");
  require(write_points(path, *points).ok(), "points can be written");
  const auto again = read_points(path);
  require(again.ok() && again->size() == points->size(), "written points can be read");
  for (std::size_t i = 0; moving && i < points->size(); ++i) {
    require(is_same((*points)[i], (*again)[i]), "points round-trip");
  }
}

void check_flow(View content) {
  static const auto files = CaptureFolder::open(input_folder().path(), false);
  require(files.ok(), "the folder can be opened");
  const std::string path = input_folder().path() + "/000000.flo";
  write_input(path, {reinterpret_cast<const char*>(content.data()), content.size()});
  const auto flow = init::read_flow(**files, path);
  check_error(flow.status());
  if (!flow.ok()) return;
  const std::size_t bytes = flow->total() * flow->elemSize();
  require(bytes > 0 && bytes <= content.size(), "the flow has bytes in the file");
}

}  // namespace

const Target stgs::fuzz::kTarget{"capture_tables", seeds, nullptr, nullptr, units, memory};

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const View content(data + 1, size - 1);
  if (data[0] % kKinds == kPoints) {
    check_points(content);
  } else {
    check_flow(content);
  }
  return 0;
}
