// SPDX-License-Identifier: Apache-2.0
#include "interchange/fourdgs_write.h"

#include <zlib.h>

#include <algorithm>
#include <numbers>
#include <numeric>

#include "interchange/import.h"
#include "stgs/format/fourdgs.h"
#include "stgs/format/parallel.h"

namespace stgs {
namespace fourdgs {
namespace {

constexpr int kMaxLevel = 6;             // of the halving of the clip into chunks
constexpr std::size_t kMinChunk = 2048;  // Gaussians; smaller chunks join the longer one
constexpr std::uint8_t kRightHanded = 1, kForwardZ = 2, kUpMinusY = 4;

// Spreads 21 bits to every third bit.
std::uint64_t spread(std::uint64_t v) {
  v = (v | v << 32) & 0x1F00000000FFFF;
  v = (v | v << 16) & 0x1F0000FF0000FF;
  v = (v | v << 8) & 0x100F00F00F00F00F;
  v = (v | v << 4) & 0x10C30C30C30C30C3;
  return (v | v << 2) & 0x1249249249249249;
}

// Returns the location of a Gaussian on a curve through all positions. Their integers are from 0 to
// 2^30.
std::uint64_t curve_position(const Population& set, std::size_t i) {
  std::uint64_t out = 0;
  for (std::size_t c = 0; c < 3; ++c) {
    const std::int32_t bin = std::max(0, set.bins[kPosition][3 * i + c]);
    out |= spread(std::min<std::uint64_t>(static_cast<std::uint64_t>(bin), (1 << 21) - 1)) << c;
  }
  return out;
}

// Gaussians that are visible only in an interval.
struct ChunkPlan {
  double begin = 0, end = 0;  // seconds
  std::uint32_t level = 0;
  std::vector<std::uint32_t> members;
};

// Assigns each Gaussian to the shortest interval that contains its visible times: the clip, its
// halves, their halves, and so on. Node n has the halves 2 n and 2 n + 1.
std::vector<ChunkPlan> plan_chunks(const CodedScene& coded, double duration) {
  std::vector<std::vector<std::uint32_t>> nodes(std::size_t{2} << kMaxLevel);
  for (std::uint32_t i = 0; i < coded.support.size(); ++i) {
    const TickRange& times = coded.support[i];
    std::size_t node = 1;
    for (int level = kMaxLevel; level > 0; --level) {
      const double count = std::exp2(level), width = duration / count;
      const double slot = std::clamp(std::floor(times.begin / width), 0.0, count - 1);
      if (times.begin < slot * width || times.end > (slot + 1) * width) continue;
      node = static_cast<std::size_t>(count + slot);
      break;
    }
    nodes[node].push_back(i);
  }
  for (std::size_t n = nodes.size() - 1; n > 1; --n) {
    if (nodes[n].size() >= kMinChunk) continue;
    nodes[n / 2].insert(nodes[n / 2].end(), nodes[n].begin(), nodes[n].end());
    nodes[n].clear();
  }
  std::vector<ChunkPlan> plans;
  for (std::size_t n = 1; n < nodes.size(); ++n) {
    if (nodes[n].empty()) continue;
    const auto level = static_cast<std::uint32_t>(std::bit_width(n) - 1);
    const double width = duration / std::exp2(level);
    const auto slot = static_cast<double>(n - (std::size_t{1} << level));
    plans.push_back({slot * width, (slot + 1) * width, level, std::move(nodes[n])});
    auto& members = plans.back().members;
    std::sort(members.begin(), members.end(), [&](std::uint32_t a, std::uint32_t b) {
      return std::pair(curve_position(coded.set, a), a) <
             std::pair(curve_position(coded.set, b), b);
    });
  }
  return plans;
}

std::string decimal(double v) {
  return fmt::format("{:.9g}", v);
}

class Writer {
 public:
  Writer(const Scene& scene, const CodedScene& coded, double duration)
      : scene_(scene), coded_(coded), duration_(duration) {}

  Bytes run(std::vector<std::uint32_t>* order) {
    if (order != nullptr) order->clear();
    out_.bytes(kMagic);
    write_header();
    write_quantization();
    write_windows();
    write_frame();
    if (scene_.metadata.start_camera) write_camera(*scene_.metadata.start_camera);
    ByteWriter index;
    for (const ChunkPlan& plan : plan_chunks(coded_, duration_)) {
      write_chunk(plan, index);
      for (const std::uint32_t i : plan.members) {
        if (order != nullptr) order->push_back(coded_.source[i]);
      }
    }
    const std::size_t summary = out_.size();
    out_.bytes(index.view());
    ByteWriter footer;
    footer.u64(index.size() > 0 ? summary : 0);
    footer.u64(0);
    footer.u32(index.size() > 0 ? static_cast<std::uint32_t>(::crc32(
                                      0, index.view().data(), static_cast<uInt>(index.size())))
                                : 0);
    write_record(out_, kFooter, footer.view());
    out_.bytes(kMagic);
    return out_.take();
  }

 private:
  void write_header() {
    const SceneMetadata& m = scene_.metadata;
    std::map<std::string, std::string> attributes = {
        {kColourKey, kDisplayColour},
        {kFrameKey, fmt::format("{}/{}", m.time_base.numerator, m.time_base.denominator)}};
    if (!m.title.empty()) attributes[kTitleKey] = m.title;
    ByteWriter w;
    w.string("");  // profile
    w.string("stgs");
    w.f64(duration_);
    w.u64(coded_.source.size());
    w.f64(coded_.grid.cutoff);
    w.string(kBirth);
    for (const double v : coded_.bounds) w.f64(v);
    w.u8(static_cast<std::uint8_t>(scene_.gaussians.sh_degree));
    w.u8(0);  // flags: no audio
    write_map(w, attributes);
    write_record(out_, kHeader, w.view());
  }

  void write_quantization() {
    const Grid& g = coded_.grid;
    ByteWriter w;
    w.string(kScheme);
    for (const double v : g.origin) w.f64(v);
    for (const double step : {g.position, g.log_scale, g.rotation, g.colour, g.opacity, g.motion,
                              g.time, g.log_sigma}) {
      w.f64(step);
    }
    w.u8(1);
    // Greatest errors. That of the omitted component of a rotation is at most sqrt(3) times that of
    // the others, because it is the largest.
    write_map(w, {{"pos", decimal(g.position / 2)},
                  {"scale_rel", decimal(std::expm1(g.log_scale / 2))},
                  {"rot", decimal(2 * g.rotation)},
                  {"rgb", decimal(g.colour / 2)},
                  {"alpha", decimal(g.opacity / 2)},
                  {"motion", decimal(g.motion / 2)},
                  {"time", decimal(g.time / 2)},
                  {"sigma_rel", decimal(std::expm1(g.log_sigma / 2))},
                  {"sh", "0"}});
    write_record(out_, kQuantization, w.view());
  }

  void write_windows() {
    ByteWriter w;
    w.u32(static_cast<std::uint32_t>(coded_.windows.size()));
    for (const Window& window : coded_.windows) {
      w.f64(window.begin);
      w.f64(window.end);
    }
    write_record(out_, kWindowTable, w.view());
  }

  void write_frame() {
    ByteWriter w;
    w.string("");  // the scene's own frame
    w.u8(kRightHanded);
    w.u8(kUpMinusY);
    w.u8(kForwardZ);
    w.u8(0);  // no name for the unit
    w.f64(scene_.metadata.metres_per_unit);
    write_record(out_, kFrame, w.view());
  }

  void write_camera(const StartCamera& camera) {
    ByteWriter w;
    w.f64(2 * std::atan(camera.height / (2 * double{camera.fy})) * 180 / std::numbers::pi);
    std::array<double, 3> position{};
    for (std::size_t c = 0; c < 3; ++c) {
      for (std::size_t row = 0; row < 3; ++row) {
        position[c] -= double{camera.rotation[3 * row + c]} * camera.translation[row];
      }
    }
    for (const double v : position) w.f64(v);
    for (std::size_t c = 0; c < 3; ++c) w.f64(position[c] + camera.rotation[6 + c]);
    w.u32(0);  // no path
    w.string("linear");
    w.u8(0);
    write_record(out_, kCamera, w.view());
  }

  // Returns a stream, or the contents of the record of an SH band.
  ByteWriter attribute_stream(const ChunkPlan& plan, std::size_t attribute) const {
    const std::size_t channels = kChannels[attribute];
    std::vector<std::int32_t> values;
    values.reserve(plan.members.size() * channels);
    for (const std::uint32_t i : plan.members) {
      const auto first =
          coded_.set.bins[attribute].begin() + static_cast<std::ptrdiff_t>(i * channels);
      values.insert(values.end(), first, first + static_cast<std::ptrdiff_t>(channels));
    }
    ByteWriter out;
    write_stream(out, static_cast<std::uint8_t>(attribute), channels, values);
    return out;
  }
  ByteWriter band_content(const ChunkPlan& plan, int band) const {
    const BandRange range = band_range(band);
    const std::size_t width = range.last - range.first;
    const std::size_t all = band_range(scene_.gaussians.sh_degree + 1).first;
    std::vector<std::int32_t> values;
    values.reserve(plan.members.size() * 3 * width);
    for (const std::uint32_t i : plan.members) {
      for (std::size_t k = 0; k < 3 * width; ++k) {
        values.push_back(coded_.set.sh[(i * all + range.first + k % width) * 3 + k / width]);
      }
    }
    ByteWriter out;
    out.u8(static_cast<std::uint8_t>(band));
    write_stream(out, kBand, 3 * width, values);
    return out;
  }

  void write_chunk(const ChunkPlan& plan, ByteWriter& index) {
    const auto bands = static_cast<std::size_t>(scene_.gaussians.sh_degree);
    std::vector<ByteWriter> parts(kAttributes + bands);
    parallel_for(std::size_t{0}, parts.size(), [&](std::size_t i) {
      parts[i] = i < kAttributes ? attribute_stream(plan, i)
                                 : band_content(plan, static_cast<int>(i - kAttributes) + 1);
    });
    std::size_t bytes = 0;
    for (std::size_t a = 0; a < kAttributes; ++a) bytes += parts[a].size();
    ByteWriter w;
    w.f64(plan.begin);
    w.f64(plan.end);
    w.u32(plan.level);
    w.u32(static_cast<std::uint32_t>(plan.members.size()));
    w.string("");  // the streams are compressed
    w.u64(bytes);
    w.u64(bytes);
    for (std::size_t a = 0; a < kAttributes; ++a) w.bytes(parts[a].view());
    const std::size_t at = out_.size();
    write_record(out_, kChunk, w.view());
    ByteWriter entry;
    entry.f64(plan.begin);
    entry.f64(plan.end);
    entry.u64(at);
    entry.u64(out_.size() - at);
    entry.u32(static_cast<std::uint32_t>(plan.members.size()));
    entry.u32(static_cast<std::uint32_t>(bands));
    for (std::size_t band = 1; band <= bands; ++band) {
      const std::size_t band_at = out_.size();
      write_record(out_, kBand, parts[kAttributes + band - 1].view());
      entry.u8(static_cast<std::uint8_t>(band));
      entry.u64(band_at);
      entry.u64(out_.size() - band_at);
    }
    write_record(index, kChunkIndex, entry.view());
  }

  const Scene& scene_;
  const CodedScene& coded_;
  double duration_;
  ByteWriter out_;
};

// Notes the metadata that the format cannot hold.
void note_lost_metadata(const SceneMetadata& m, ConversionNotes* notes) {
  note_kernel(m.kernel, "4dgs", notes);
  const std::string lost = list_metadata(m, "the image size and roll of the start camera", false);
  if (!lost.empty()) note(notes, fmt::format("4dgs cannot hold {}", lost));
}

}  // namespace
}  // namespace fourdgs

Result<std::vector<std::uint8_t>> write_4dgs(const Scene& scene, ConversionNotes* notes,
                                             std::vector<std::uint32_t>* order) {
  STGS_TRY(check_export(scene.gaussians));
  const SceneMetadata& m = scene.metadata;
  if (m.frames == 0 || m.time_base.numerator == 0 || m.time_base.denominator == 0) {
    return usage_error("invalid duration ({} frames of {}/{} s)", m.frames, m.time_base.numerator,
                       m.time_base.denominator);
  }
  const double duration = m.time_base.seconds(m.frames);
  STGS_ASSIGN(const fourdgs::CodedScene coded, fourdgs::encode_set(scene, duration, notes));
  fourdgs::note_lost_metadata(m, notes);
  return fourdgs::Writer(scene, coded, duration).run(order);
}

}  // namespace stgs
