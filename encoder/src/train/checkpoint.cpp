// SPDX-License-Identifier: Apache-2.0
#include "train/checkpoint.h"

#include <xxhash.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <type_traits>

#include "archive.h"
#include "train/quantisation_fields.h"

namespace stgs::encoder {
namespace {

const ArchiveKind kCheckpoint = {
    .magic = {'S', 'T', 'G', 'S', 'C', 'K', 'P', '8'},
    .noun = "checkpoint",
    .if_damaged = "resume from another one or train from the start",
    .if_other = "resume with the version that wrote it, or train from the start without it"};

class Hasher {
 public:
  template <typename T>
  void value(const T& v) {
    static_assert(std::is_trivially_copyable_v<T>);
    add(&v, sizeof(T));
  }
  template <typename Container>
  void array(const Container& v) {
    add(v.data(), v.size() * sizeof(typename Container::value_type));
  }
  std::uint64_t hash() const { return hash_; }

 private:
  void add(const void* bytes, std::size_t n) { hash_ = XXH3_64bits_withSeed(bytes, n, hash_); }

  std::uint64_t hash_ = 0;
};

// Visits the fields of the compaction in file order.
template <typename Compaction, typename Archive>
void visit_compaction(Compaction& compaction, Archive& archive) {
  archive.value(compaction.prunings);
  archive.value(compaction.keep);
  archive.value(compaction.quality);
  archive.value(compaction.psnr);
  Quantisation q = compaction.quantisation.value_or(Quantisation());
  std::uint32_t rounding = compaction.is_rounding() ? 1 : 0;
  archive.value(rounding);
  visit_quantisation(q, archive);
  archive.value(compaction.rules);
  archive.array(compaction.importance);
  archive.array(compaction.tier);
  if constexpr (!std::is_const_v<Compaction>) {
    if (rounding != 0) compaction.quantisation = std::move(q);
  }
}

// Visits every field in file order, for writing, reading and hashing.
template <typename State, typename Archive>
void visit_state(State& state, Archive& archive) {
  archive.value(state.iteration);
  archive.value(state.second_stage);
  archive.value(state.opacity_resets);
  archive.value(state.seconds);
  archive.value(state.mean_loss);
  archive.value(state.set.sh_degree);
  archive.value(state.coupled.tick);
  archive.array(state.set.velocity);
  archive.array(state.set.sigma);
  for (int a = 0; a < kAttributes; ++a) {
    archive.array(state.values(a));
    archive.array(state.moments[a].first);
    archive.array(state.moments[a].second);
  }
  archive.array(state.updates);
  archive.array(state.statistics.gradient_sum);
  archive.array(state.statistics.abs_gradient_sum);
  archive.array(state.statistics.error_max);
  archive.array(state.statistics.views);
  archive.value(state.background);
  archive.array(state.colour);
  archive.array(state.colour_first);
  archive.array(state.colour_second);
  archive.array(state.colour_updates);
  archive.array(state.cameras);
  archive.array(state.cameras_first);
  archive.array(state.cameras_second);
  archive.array(state.camera_updates);
  archive.array(state.camera_sums);
  archive.array(state.camera_views);
  visit_compaction(state.compaction, archive);
}

// A RecordedSet as a file has it.
struct RecordedArrays {
  std::uint64_t bytes = 0;
  std::vector<std::uint64_t> records;
  std::vector<std::uint32_t> indices;

  template <typename Archive>
  void visit(Archive& archive) {
    archive.value(bytes);
    archive.array(records);
    archive.array(indices);
  }
};

void write_recorded(const RecordedSet& recorded, ArchiveWriter& writer) {
  RecordedArrays arrays;
  arrays.bytes = recorded.bytes;
  for (const StoredPrimitive& primitive : recorded.primitives) {
    arrays.records.push_back(primitive.record);
    arrays.indices.push_back(primitive.index);
  }
  arrays.visit(writer);
}

// Returns whether the arrays match.
bool read_recorded(ArchiveReader& reader, RecordedSet& recorded) {
  RecordedArrays arrays;
  arrays.visit(reader);
  if (arrays.records.size() != arrays.indices.size()) return false;
  recorded.bytes = arrays.bytes;
  for (std::size_t k = 0; k < arrays.records.size(); ++k)
    recorded.primitives.push_back({arrays.records[k], arrays.indices[k]});
  return true;
}

// Allocates the arrays that the coupled form determines and a checkpoint therefore omits.
void restore_derived(TrainState& state) {
  if (!state.is_coupled()) return;
  const std::size_t n = state.set.opacity_logit.size();
  state.set.log_scale.resize(3 * n);
  state.set.rotation.resize(4 * n);
  state.velocity.resize(3 * n);
  state.log_sigma.resize(n);
}

// Returns whether a compaction of n primitives has its arrays, and numbers that the following
// rounds and steps can use.
bool is_consistent(const CompactionState& compaction, std::size_t n) {
  const std::size_t rounded = compaction.is_rounding() ? n : 0;
  if (compaction.importance.size() != rounded || compaction.tier.size() != rounded) return false;
  const bool chosen = compaction.keep >= 0 && compaction.keep <= 1 && compaction.quality >= 0 &&
                      compaction.quality <= 100 && !std::isnan(compaction.psnr) &&
                      (compaction.prunings == 0 || compaction.keep > 0);
  if (!chosen || !compaction.is_rounding()) return chosen;
  const Quantisation& quantisation = *compaction.quantisation;
  const std::size_t tiers = quantisation.tiers.size();
  return is_valid(quantisation) && tiers <= std::size_t{kMaxRoundingTiers} &&
         std::all_of(compaction.tier.begin(), compaction.tier.end(),
                     [tiers](std::uint8_t tier) { return tier < tiers; });
}

// Returns whether the corrections of the cameras are small, and their steps possible.
bool are_usable(const TrainState& state) {
  constexpr float kMaxCorrection = 1e6f, kMaxLogFocal = 1;
  const auto within = [](const std::vector<CameraCorrection>& all, float least, float most) {
    return std::all_of(all.begin(), all.end(), [&](const CameraCorrection& values) {
      return std::all_of(values.begin(), values.end(),
                         [&](float v) { return v >= least && v <= most; });
    });
  };
  const float most = std::numeric_limits<float>::max();
  return within(state.cameras, -kMaxCorrection, kMaxCorrection) &&
         std::all_of(state.cameras.begin(), state.cameras.end(),
                     [](const CameraCorrection& c) {
                       return std::abs(c[kLogFocal]) <= kMaxLogFocal &&
                              std::abs(c[kDistortion]) <= kMaxDistortion &&
                              std::abs(c[kVignetting]) <= kMaxVignetting &&
                              std::abs(c[kTimeShift]) <= kMaxTimeShift;
                     }) &&
         within(state.cameras_first, -most, most) && within(state.cameras_second, 0, most) &&
         within(state.camera_sums, -most, most) &&
         std::all_of(state.camera_updates.begin(), state.camera_updates.end(),
                     [&](std::uint32_t updates) { return updates <= state.iteration; });
}

// Returns whether all arrays agree on N and on the number of cameras.
bool is_consistent(const TrainState& state) {
  const std::size_t n = state.size();
  if (state.set.sh_degree < 0 || state.set.sh_degree > 3) return false;
  bool same = state.set.velocity.size() == 3 * n && state.set.sigma.size() == n;
  for (int a = 0; a < kAttributes; ++a) {
    const std::size_t expected = n * state.components(a);
    same = same && state.values(a).size() == expected &&
           state.moments[a].first.size() == expected && state.moments[a].second.size() == expected;
  }
  same = same && is_consistent(state.compaction, n);
  const std::size_t cameras = state.colour.size(), refined = state.cameras.size();
  same = same && (refined == 0 || refined == cameras) && state.cameras_first.size() == refined &&
         state.cameras_second.size() == refined && state.camera_updates.size() == refined &&
         state.camera_sums.size() == refined && state.camera_views.size() == refined &&
         are_usable(state);
  return same && state.updates.size() == n && state.statistics.gradient_sum.size() == n &&
         state.statistics.abs_gradient_sum.size() == n && state.statistics.error_max.size() == n &&
         state.statistics.views.size() == n && state.colour_first.size() == cameras &&
         state.colour_second.size() == cameras && state.colour_updates.size() == cameras;
}

}  // namespace

Status write_checkpoint(const std::string& path, const TrainState& state,
                        const Fingerprint& fingerprint, const RecordedSet& recorded,
                        const std::vector<std::vector<std::uint8_t>>& residuals) {
  ArchiveWriter writer(kCheckpoint);
  writer.array(fingerprint_text(fingerprint));
  visit_state(state, writer);
  write_recorded(recorded, writer);
  writer.value(static_cast<std::uint32_t>(residuals.size()));
  for (const std::vector<std::uint8_t>& residual : residuals) writer.array(residual);
  return writer.save(path);
}

Status check_state(const std::string& path, const TrainState& state, const PreparedCapture& capture,
                   int sh_degree, bool coupled, bool refined) {
  if (state.colour.size() == capture.training_cameras().size() &&
      state.set.sh_degree == sh_degree && state.is_coupled() == coupled &&
      state.cameras.empty() == !refined &&
      state.iteration <= static_cast<std::uint64_t>(std::numeric_limits<int>::max())) {
    return {};
  }
  return invalid_file(
      "{}: damaged checkpoint (its state is not that of the run that it states); resume from "
      "another one or train from the start",
      path);
}

std::uint64_t state_hash(const TrainState& state) {
  Hasher hasher;
  visit_state(state, hasher);
  return hasher.hash();
}

Result<Checkpoint> read_checkpoint(const std::string& path) {
  STGS_ASSIGN(ArchiveReader reader, ArchiveReader::open(path, kCheckpoint));
  std::string text;
  reader.array(text);
  Checkpoint checkpoint;
  TrainState& state = checkpoint.state;
  visit_state(state, reader);
  restore_derived(state);
  const bool matches = read_recorded(reader, checkpoint.recorded);
  std::uint32_t views = 0;
  reader.value(views);
  for (std::uint32_t v = 0; v < views && reader.ok(); ++v)
    reader.array(checkpoint.residuals.emplace_back());
  if (!matches || !reader.complete() || !is_consistent(state)) {
    return invalid_file("{}: damaged checkpoint (inconsistent array sizes)", path);
  }
  if (state.is_coupled()) state.derive_all(false);
  Result<Fingerprint> fingerprint = read_fingerprint(text);
  if (!fingerprint.ok()) return invalid_file("{}: {}", path, fingerprint.status().message());
  checkpoint.fingerprint = *std::move(fingerprint);
  return checkpoint;
}

}  // namespace stgs::encoder
