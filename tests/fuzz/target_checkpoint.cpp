// SPDX-License-Identifier: Apache-2.0
// Checkpoints of training. The unpacked form has no checksum.
#include <xxhash.h>

#include <cstring>
#include "../fixtures/file_bytes.h"
#include "packed_files.h"
#include "train/checkpoint.h"
#include "train/coupled_state.h"

using namespace stgs;
using namespace stgs::fuzz;
using namespace stgs::encoder;

namespace {

constexpr std::size_t kHash = 8;

TrainState small_state(std::size_t primitives, int sh_degree, std::size_t cameras) {
  TrainState state;
  state.set.sh_degree = sh_degree;
  state.resize(primitives);
  for (std::size_t i = 0; i < primitives; ++i) {
    state.set.position[3 * i] = static_cast<float>(i);
    state.set.rotation[4 * i] = 1;
  }
  state.statistics.reset(primitives);
  state.colour.assign(cameras, kIdentityColour);
  state.colour_first.resize(cameras);
  state.colour_second.resize(cameras);
  state.colour_updates.resize(cameras);
  state.iteration = 100;
  state.mean_loss = 0.1;
  state.derive_all(true);
  return state;
}

// A state that is being rounded.
TrainState rounded_state() {
  TrainState state = small_state(3, 1, 1);
  CompactionState& compaction = state.compaction;
  compaction.prunings = 2;
  compaction.keep = 0.5;
  compaction.quality = 60;
  compaction.importance = {1, 2, 3};
  compaction.tier = {0, 1, 1};
  compaction.quantisation = choose_quantisation(state.set, compaction.importance, 10, 60);
  compaction.tier.assign(3, 0);
  compaction.rules = rounding_rules(*compaction.quantisation, 10, state.set, compaction.tier);
  return state;
}

std::vector<Bytes> seeds() {
  TrainState coupled = small_state(2, 0, 2);
  start_coupled(coupled, 0.1f);
  coupled.derive_all(false);
  const Fingerprint fingerprint = {{"frames", "10"}, {"seed", "1"}, {"backend", "cpu"}};
  std::vector<Bytes> out;
  for (const TrainState& state :
       {small_state(2, 1, 3), small_state(0, 0, 0), rounded_state(), coupled}) {
    const std::string path = input_folder().beside("seed.ckpt");
    require(write_checkpoint(path, state, fingerprint).ok(), "seeds can be written");
    out.push_back(testing::bytes_of(path));
    require(read_checkpoint(path).ok(), "seeds can be read");
  }
  return out;
}

Bytes unpack(View input) {
  return {input.begin(), input.end() - static_cast<std::ptrdiff_t>(std::min(kHash, input.size()))};
}

Bytes repack(Bytes form, Repair repair) {
  const std::uint64_t hash = repair == Repair::kNothing ? 0 : XXH3_64bits(form.data(), form.size());
  form.resize(form.size() + kHash);
  std::memcpy(&form[form.size() - kHash], &hash, kHash);
  return form;
}

// The magic, the fingerprint, and the rest, which begins with the counts of the run.
std::vector<Unit> units(View form) {
  constexpr std::size_t kText = 16;
  std::uint64_t length = 0;
  if (form.size() < kText) return {{0, form.size()}};
  std::memcpy(&length, &form[8], sizeof length);
  const std::size_t end = kText + std::min<std::uint64_t>(length, form.size() - kText);
  return {{0, end}, {end, form.size()}, {end, form.size()}};
}

// The file, its arrays, those that the coupled form determines, the rounded set, and both files of
// the round trip.
std::uint64_t memory(View input) {
  return 64 * input.size() + (64 << 10);
}

}  // namespace

const Target stgs::fuzz::kTarget{"checkpoint", seeds, unpack, repack, units, memory};

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string path = input_folder().beside("input.ckpt"),
                    again = input_folder().beside("again.ckpt");
  write_input(path, {reinterpret_cast<const char*>(data), size});
  const auto checkpoint = read_checkpoint(path);
  if (!checkpoint.ok()) {
    const StatusCode code = checkpoint.status().code();
    require((code == StatusCode::kInvalidFile || code == StatusCode::kUnsupported) &&
                !checkpoint.status().message().empty(),
            "a damaged checkpoint is invalid or unsupported");
    return 0;
  }
  const TrainState& state = checkpoint->state;
  if (state.compaction.is_rounding()) {
    require(is_valid(*state.compaction.quantisation), "the steps of a state are valid");
    require(rounded_set(state).size() == state.size(), "a state can be rounded");
  }
  (void)check_same_run("input", checkpoint->fingerprint, {{"frames", "10"}, {"seed", "2"}});
  require(write_checkpoint(again, state, checkpoint->fingerprint).ok(),
          "a checkpoint that is read can be written");
  const auto second = read_checkpoint(again);
  require(second.ok() && state_hash(second->state) == state_hash(state),
          "a checkpoint round-trips");
  const Bytes first_bytes = testing::bytes_of(again);
  require(write_checkpoint(again, second->state, second->fingerprint).ok() &&
              testing::bytes_of(again) == first_bytes,
          "a checkpoint is written to the same bytes");
  return 0;
}
