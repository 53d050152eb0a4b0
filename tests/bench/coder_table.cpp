// SPDX-License-Identifier: Apache-2.0
#include "coder_table.h"

#include <zstd.h>

#include <cmath>
#include <cstdlib>
#include <numeric>

#include "codec/draco_points.h"
#include "codec/layout_plan.h"
#include "codec/planes.h"
#include "codec/rans.h"
#include "min_time.h"
#include "quantise/quantise.h"
#include "quantise/step_chooser.h"

namespace stgs::bench {
namespace {

nlohmann::json row_of(std::size_t bytes, std::size_t n, double encode, double decode) {
  return {{"bits", std::round(800.0 * static_cast<double>(bytes) / static_cast<double>(n)) / 100},
          {"encode_mprimitives_per_s", encode},
          {"decode_mprimitives_per_s", decode}};
}

std::vector<std::uint8_t> make_planes(const Integers& integers, Coder coder, StreamPlan& plan) {
  const Integers* const records[] = {&integers};
  plan = plan_stream(records, coder);
  std::vector<std::uint8_t> planes;
  append_planes(integers, plan, planes);
  return planes;
}

nlohmann::json measure_bytes(const Integers& integers, std::size_t n, nlohmann::json& stored) {
  StreamPlan plan;
  const std::vector<std::uint8_t> planes = make_planes(integers, Coder::kBytes, plan);
  std::vector<std::uint8_t> decoded(planes.size());
  const double copy =
      millions_per_second(n, [&] { std::copy(planes.begin(), planes.end(), decoded.begin()); });
  stored = row_of(planes.size(), n, copy, copy);
  constexpr int kLevel = 9;
  std::vector<std::uint8_t> frame(ZSTD_compressBound(planes.size()));
  const auto compress = [&] {
    return ZSTD_compress(frame.data(), frame.size(), planes.data(), planes.size(), kLevel);
  };
  const std::size_t size = compress();
  return row_of(size, n, millions_per_second(n, [&] { (void)compress(); }),
                millions_per_second(n, [&] {
                  (void)ZSTD_decompress(decoded.data(), decoded.size(), frame.data(), size);
                }));
}

nlohmann::json measure_rans(const Integers& integers, std::size_t n) {
  StreamPlan plan;
  const std::vector<std::uint8_t> planes = make_planes(integers, Coder::kRans, plan);
  const std::size_t count = plan.row.planes();
  const auto plane = [&](std::size_t p) { return std::span(planes).subspan(p * n, n); };
  TablePlan tables;
  std::vector<std::uint8_t> group;
  const auto encode = [&] {
    std::vector<SymbolCounts> counts(count);
    for (std::size_t p = 0; p < count; ++p) {
      for (const std::uint8_t s : plane(p)) ++counts[p][s];
    }
    tables = plan_tables(counts);
    std::vector<RansPlane> coded;
    for (std::size_t p = 0; p < count; ++p) {
      const RansTable& table = tables.tables[tables.table_of[p]];
      if (only_symbol(table) < 0) coded.push_back({plane(p), &table});
    }
    group = *rans_encode(coded, n);
  };
  const double encode_speed = millions_per_second(n, encode);
  ByteWriter stored;
  for (const RansTable& table : tables.tables) write_rans_table(table, stored);
  std::vector<RansLookup> lookups(tables.tables.size());
  for (std::size_t t = 0; t < lookups.size(); ++t) rans_lookup(tables.tables[t], lookups[t]);
  std::vector<std::uint8_t> decoded(n);
  const double decode_speed = millions_per_second(n, [&] {
    auto decoder = RansGroupDecoder::open(group, n);
    for (std::size_t p = 0; p < count; ++p) {
      const std::uint16_t table = tables.table_of[p];
      if (only_symbol(tables.tables[table]) < 0)
        decoder->next_plane(lookups[table], decoded.data());
    }
    if (!decoder->finish()) std::abort();
  });
  return row_of(group.size() + stored.size(), n, encode_speed, decode_speed);
}

// Positions coded by Draco's kd-tree; decoding includes restoring their order and planes.
nlohmann::json measure_draco(const Integers& positions, std::size_t n, int speed) {
  const StreamPlan plan = plan_draco(positions);
  std::vector<std::uint8_t> planes, stored;
  append_planes(positions, plan, planes);
  const double encode = millions_per_second(n, [&] { stored = draco_encode(planes, n, speed); });
  std::vector<std::uint8_t> decoded(planes.size());
  const double decode = millions_per_second(n, [&] {
    if (!draco_fits(stored, n) || draco_decode(stored, n, decoded) != nullptr) std::abort();
  });
  return row_of(stored.size(), n, encode, decode);
}

}  // namespace

nlohmann::json coder_table(const Scene& scene) {
  const std::uint32_t frames = scene.metadata.frames;
  const std::vector<float> importance =
      scene.importance.empty() ? importance_by_size(scene.gaussians, frames) : scene.importance;
  const StepChooser chooser(scene.gaussians, importance, scene.importance.empty(), frames,
                            {.quality = 85});
  Quantisation rules = chooser.rules();
  set_tiers(chooser, {}, importance, rules);
  const Quantiser quantiser(rules);
  const PartRange full_range{
      0, static_cast<std::uint32_t>(scene.gaussians.size()), {0.0, static_cast<double>(frames)}};
  const Gaussians4D snapped = quantiser.snap_lifespans(scene.gaussians, {&full_range, 1});
  std::vector<std::uint32_t> members(snapped.size()), order;
  std::iota(members.begin(), members.end(), 0u);
  const GroupSteps steps = quantiser.steps_of(snapped, members, 0);
  nlohmann::json out;
  for (const Integers& integers :
       quantiser.quantise(snapped, steps, 0.0, part_exponent_of(frames), order)) {
    nlohmann::json& row = out[name_of(integers.attribute)];
    row["zstd"] = measure_bytes(integers, snapped.size(), row["stored"]);
    row["rans"] = measure_rans(integers, snapped.size());
    if (!integers.morton || !check_draco().ok()) continue;
    for (const int speed : {0, 5, 10}) {
      row[fmt::format("draco_speed_{}", speed)] = measure_draco(integers, snapped.size(), speed);
    }
  }
  return out;
}

}  // namespace stgs::bench
