// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/persistent_set.h"

#include "train/checkpoint.h"
#include "train/persistence.h"

namespace stgs::encoder {
namespace {

// A set is stored like a checkpoint, with this entry alone.
const Fingerprint& kind_of_set() {
  static const Fingerprint kind = {{"kind", "persistent set"}};
  return kind;
}

}  // namespace

Result<PersistentSet> PersistentSet::read(const std::string& path) {
  STGS_ASSIGN(Checkpoint file, read_checkpoint(path));
  if (file.fingerprint != kind_of_set()) {
    return invalid_file("{}: this is a checkpoint of 'stgs train' (expected a persistent set)",
                        path);
  }
  const std::size_t stored = file.recorded.primitives.size(), members = file.state.count_fixed();
  if (stored != members && stored != 0)
    return invalid_file("{}: damaged (expected {} stored primitives, got {})", path, members,
                        stored);
  return PersistentSet(std::make_shared<const TrainState>(std::move(file.state)), false,
                       std::move(file.recorded), std::move(file.residuals));
}

Status PersistentSet::write(const std::string& path) const {
  return write_checkpoint(path, state_ ? *state_ : TrainState(), kind_of_set(), recorded_,
                          residuals_);
}

std::size_t PersistentSet::size() const {
  return state_ ? state_->count_fixed() : 0;
}

PersistentSet PersistentSet::without_moving() const {
  if (!state_ || !carries_moving_) return *this;
  std::vector<std::uint32_t> kept;
  for (std::size_t i = 0; i < state_->size(); ++i) {
    if (is_persistent(*state_, i)) kept.push_back(static_cast<std::uint32_t>(i));
  }
  TrainState state = *state_;
  state.retain(kept);
  return PersistentSet(std::make_shared<const TrainState>(std::move(state)), true, recorded_,
                       residuals_);
}

}  // namespace stgs::encoder
