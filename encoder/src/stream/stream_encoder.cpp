// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/stream_encoder.h"

#include <algorithm>
#include <filesystem>
#include <utility>

#include "pack/metadata.h"
#include "stgs/format/damage_report.h"
#include "stgs/format/output_file.h"
#include "stream/round.h"
#include "stream/window_trainer.h"
#include "train/persistence.h"
#include "train/train_state.h"

namespace stgs::encoder {
namespace {

namespace fs = std::filesystem;

// Frames for which persistent primitives are displayed: more than a capture has (kCaptureLimits).
constexpr std::uint32_t kPersistentFrames = 1u << 20;
// Marks a member that the set does not contain any more. No record begins at this offset.
constexpr StoredPrimitive kEnded = {~std::uint64_t{0}, 0};

// Returns the primitives of part p of a scene.
Gaussians4D primitives_of(const Scene& scene, std::size_t p) {
  std::size_t first = 0;
  for (std::size_t k = 0; k < p; ++k) first += scene.parts[k].primitives;
  std::vector<std::uint32_t> members(scene.parts[p].primitives);
  for (std::size_t i = 0; i < members.size(); ++i)
    members[i] = static_cast<std::uint32_t>(first + i);
  return scene.gaussians.gather(members);
}

// Returns members of a set as they are displayed at all times.
Gaussians4D members_of(const PersistentSet& set, const std::vector<std::uint32_t>& members) {
  Gaussians4D none;
  if (members.empty()) return none;
  const TrainState& state = *set.state();
  std::vector<std::uint32_t> fixed, indices;
  for (std::size_t i = 0; i < state.size(); ++i)
    if (state.is_fixed(i)) fixed.push_back(static_cast<std::uint32_t>(i));
  for (const std::uint32_t m : members) indices.push_back(fixed[m]);
  return state.set.gather(indices);
}

// Returns members of a set that are displayed until their frame of a window.
Gaussians4D members_until(const PersistentSet& set, const std::vector<MemberEnd>& ends) {
  std::vector<std::uint32_t> members;
  for (const MemberEnd& end : ends) members.push_back(end.member);
  Gaussians4D out = members_of(set, members);
  for (std::size_t i = 0; i < ends.size(); ++i) end_at(out, i, static_cast<int>(ends[i].frame));
  return out;
}

}  // namespace

RecordSettings StreamEncoder::record_settings() const {
  RecordSettings out;
  out.sync = settings_.resumable;
  out.ends = true;
  const PackSettings& pack = settings_.pack;
  out.write.profile = pack.profile;
  if (pack.quality > 0) out.write.quality = pack.quality;
  out.write.max_error = pack.max_error;
  out.write.tiers = pack.tiers;
  out.write.chunk_seconds = pack.chunk_seconds;
  return out;
}

namespace {

// Returns the persistent sets in a folder, the latest last.
Result<std::vector<fs::path>> list_sets(const std::string& folder) {
  std::error_code error;
  std::vector<fs::path> sets;
  fs::directory_iterator entries(folder, error);
  for (; !error && entries != fs::directory_iterator(); entries.increment(error)) {
    if (entries->path().extension() == ".set") sets.push_back(entries->path());
  }
  if (error) return io_error("{}: cannot be listed: {}", folder, error.message());
  std::sort(sets.begin(), sets.end());
  return sets;
}

}  // namespace

StreamEncoder::StreamEncoder(std::string folder, StreamSettings settings)
    : folder_(std::move(folder)), settings_(std::move(settings)) {}

StreamEncoder::~StreamEncoder() = default;

Result<std::unique_ptr<StreamEncoder>> StreamEncoder::open(const std::string& folder,
                                                           const StreamSettings& settings) {
  STGS_ASSIGN(WindowTrainer trainer, WindowTrainer::create(settings));
  std::unique_ptr<StreamEncoder> encoder(new StreamEncoder(folder, settings));
  encoder->trainer_ = std::make_unique<WindowTrainer>(std::move(trainer));
  encoder->set_ = PersistentSet(settings.carries_moving);
  const std::string identity_path = identity_path_of(folder);
  const std::string& identity = encoder->trainer_->identity();
  std::error_code ignored;
  if (!settings.resumable) {
    if (!fs::is_empty(folder, ignored))
      return usage_error("{}: contains other files; name a new or empty folder", folder);
    if (fs::exists(encoder->recording_path(), ignored))
      return usage_error("{}: exists; name another file", encoder->recording_path());
    return encoder;
  }
  const bool has_run = fs::exists(identity_path, ignored);
  if (!has_run && !fs::is_empty(folder, ignored))
    return usage_error("{}: contains other files; name a new or empty folder", folder);
  STGS_ASSIGN(const std::vector<fs::path> sets, list_sets(folder));
  if (!has_run || sets.empty() || !fs::exists(encoder->recording_path(), ignored)) {
    // No window was completed: nothing is lost, whatever run it was.
    for (const fs::path& path : sets) fs::remove(path, ignored);
    fs::remove(encoder->recording_path(), ignored);
    STGS_TRY(write_file_atomically(
        identity_path, {reinterpret_cast<const std::uint8_t*>(identity.data()), identity.size()}));
    return encoder;
  }
  STGS_ASSIGN(const bool is_same, encoder->trainer_->is_run_of(folder));
  if (!is_same) {
    return usage_error(
        "{}: holds an incomplete encoding of another capture or with other settings; repeat its "
        "command to complete it, or remove the folder",
        folder);
  }
  STGS_TRY(encoder->resume(sets.back().string()));
  return encoder;
}

Status StreamEncoder::resume(const std::string& newest_set) {
  STGS_ASSIGN(set_, PersistentSet::read(newest_set));
  if (set_.recorded().primitives.size() != set_.size())
    return invalid_file("{}: damaged; remove {} and encode again", newest_set, folder_);
  STGS_ASSIGN(recorder_, SceneRecorder::resume(recording_path(), record_settings()));
  // The set of the last round is missing: some of its fragments may be, too.
  if (recorder_->bytes() > set_.recorded().bytes) {
    recorder_.reset();
    std::error_code error;
    fs::resize_file(recording_path(), set_.recorded().bytes, error);
    if (error) return io_error("{}: cannot be truncated: {}", recording_path(), error.message());
    STGS_ASSIGN(recorder_, SceneRecorder::resume(recording_path(), record_settings()));
  }
  if (recorder_->bytes() != set_.recorded().bytes) {
    return invalid_file("{}: damaged (expected {} bytes, got {}); remove {} and encode again",
                        recording_path(), set_.recorded().bytes, recorder_->bytes(), folder_);
  }
  STGS_ASSIGN(const PreparedCapture first, read_prepared_capture(folder_));
  trainer_->take_bounds(first);
  // A killed process can leave the set of the window before.
  STGS_ASSIGN(const std::vector<fs::path> sets, list_sets(folder_));
  std::error_code ignored;
  for (const fs::path& path : sets) {
    if (path != newest_set) fs::remove(path, ignored);
  }
  return {};
}

int StreamEncoder::frames() const {
  return recorder_ ? static_cast<int>(recorder_->frames()) : 0;
}

Result<StreamWindow> StreamEncoder::encode(const PreparedCapture& window,
                                           const ProgressSink& progress, const LogSink& log,
                                           const WindowWork& work) {
  std::vector<TrainedWindow> round(1);
  STGS_ASSIGN(round.front(), train_window(window, progress, log, work));
  STGS_ASSIGN(std::vector<StreamWindow> recorded, append(std::move(round)));
  return std::move(recorded.front());
}

Result<TrainedWindow> StreamEncoder::train_window(const PreparedCapture& window,
                                                  const ProgressSink& progress, const LogSink& log,
                                                  const WindowWork& work) {
  try {
    if (!trainer_->has_bounds()) {
      // A resumed run and other processes read the bounds from it.
      PreparedCapture first = window;
      first.folder = folder_;
      STGS_TRY(write_prepared_capture(first));
      trainer_->take_bounds(first);
    }
    return trainer_->train(window, set_, {frames(), frames() + window.frames}, progress, log, work);
  } catch (const std::exception& error) {
    return runtime_error("encoding the window after frame {} failed: {}", frames(), error.what());
  }
}

Result<std::vector<StreamWindow>> StreamEncoder::append(std::vector<TrainedWindow> round) {
  try {
    return append_round(std::move(round));
  } catch (const std::exception& error) {
    return runtime_error("recording the window after frame {} failed: {}", frames(), error.what());
  }
}

Result<std::vector<StreamWindow>> StreamEncoder::append_round(std::vector<TrainedWindow> round) {
  if (!recorder_) STGS_TRY(create_recording(round.front().scene));
  const int before = frames();
  std::vector<std::vector<MemberEnd>> ends;
  for (const TrainedWindow& window : round) ends.push_back(window.set.ends());
  STGS_TRY(check_round(round, ends));
  const std::vector<WindowPlan> plans = plan_round(set_.size(), ends);
  std::vector<StoredPrimitive> members = set_.recorded().primitives, added;
  std::vector<StreamWindow> out;
  for (std::size_t k = 0; k < round.size(); ++k) {
    TrainedWindow& window = round[k];
    StreamWindow& recorded = out.emplace_back();
    recorded.first_frame = frames();
    recorded.frames = window.frames();
    recorded.ended = ends[k].size();
    const std::uint64_t bytes = recorder_->bytes(), primitives = recorder_->primitives();
    STGS_TRY(record(window, plans[k], k + 1 == round.size(), members, added));
    recorded.primitives = recorder_->primitives() - primitives;
    recorded.bytes = recorder_->bytes() - bytes;
    recorded.training = std::move(window.training);
  }
  PersistentSet set = std::move(round.back().set);
  for (const MemberEnd& end : ends.back()) members[end.member] = kEnded;
  std::erase(members, kEnded);
  members.insert(members.end(), added.begin(), added.end());
  set.set_recorded({std::move(members), recorder_->bytes()});
  // After the fragments, which a resumed run encodes again if it lacks the set.
  if (settings_.resumable) STGS_TRY(set.write(set_path_of(folder_, frames())));
  set_ = std::move(set);
  std::error_code ignored;
  fs::remove(set_path_of(folder_, before), ignored);
  for (StreamWindow& window : out) window.persistent = set_.size();
  return out;
}

Status StreamEncoder::check_round(const std::vector<TrainedWindow>& round,
                                  const std::vector<std::vector<MemberEnd>>& ends) const {
  for (std::size_t k = 0; k < round.size(); ++k) {
    const auto frames = static_cast<std::uint32_t>(round[k].frames());
    for (const MemberEnd& end : ends[k]) {
      if (end.member >= set_.size() || end.frame > frames)
        return invalid_file(
            "{}: a window of {} frames ends primitive {} of {} at frame {}; remove the folder and "
            "encode again",
            folder_, frames, end.member, set_.size(), end.frame);
    }
  }
  const TrainedWindow& last = round.back();
  const std::size_t members = set_.size() - ends.back().size() + last.scene.parts[1].primitives;
  if (last.set.size() == members) return {};
  return invalid_file(
      "{}: a set has {} primitives (expected {}); remove the folder and encode again", folder_,
      last.set.size(), members);
}

Status StreamEncoder::create_recording(const Scene& scene) {
  SceneMetadata metadata = scene.metadata;
  metadata.title = settings_.title;
  STGS_TRY(apply_metadata(settings_.pack, metadata));
  STGS_ASSIGN(recorder_, SceneRecorder::create(recording_path(), metadata,
                                               scene.gaussians.sh_degree, record_settings()));
  return {};
}

Status StreamEncoder::record(const TrainedWindow& window, const WindowPlan& plan, bool is_last,
                             std::vector<StoredPrimitive>& members,
                             std::vector<StoredPrimitive>& added) {
  const Scene& scene = window.scene;
  const Gaussians4D own = primitives_of(scene, 0), additions = primitives_of(scene, 1);
  const Gaussians4D again = members_of(set_, plan.stored_again);
  const Gaussians4D again_until = members_until(set_, plan.displayed_again);
  const std::span<const float> importance = scene.importance;
  const auto begin = static_cast<std::uint32_t>(frames());
  const std::uint32_t stays = begin + kPersistentFrames;
  // The first part with primitives determines the chunk of the file.
  std::vector<FragmentPart> parts = {{own}, {additions, {}, is_last ? stays : 0}};
  if (!importance.empty()) {
    parts[0].importance = importance.first(own.size());
    parts[1].importance = importance.subspan(own.size());
  }
  if (again.size() > 0) parts.push_back({again, {}, stays});
  if (again_until.size() > 0) parts.push_back({again_until});
  if (scene.quantisation && settings_.pack.quality == 0) {
    for (FragmentPart& part : parts) part.quality = scene.quantisation->quality;
    if (own.size() > 0) parts[0].steps = &*scene.quantisation;
  }
  std::vector<PrimitiveEnd> ends;
  for (const MemberEnd& end : plan.ends) {
    // Primitives are displayed in the frame of their end.
    if (members[end.member].record != 0)
      ends.push_back({members[end.member], end.frame + begin - 1});
  }
  std::vector<std::vector<StoredPrimitive>> stored;
  STGS_TRY(
      recorder_->append(parts, ends, begin + static_cast<std::uint32_t>(window.frames()), &stored));
  for (std::size_t i = 0; i < plan.stored_again.size(); ++i)
    members[plan.stored_again[i]] = stored[2][i];
  if (is_last) added = std::move(stored[1]);
  return {};
}

Status StreamEncoder::skip(int frames) {
  if (!recorder_) return usage_error("{}: no window has been encoded", recording_path());
  const int before = this->frames(), after = before + frames;
  STGS_TRY(recorder_->append(std::span<const FragmentPart>(), static_cast<std::uint32_t>(after)));
  set_ = set_.without_moving();
  set_.set_recorded({set_.recorded().primitives, recorder_->bytes()});
  if (settings_.resumable) STGS_TRY(set_.write(set_path_of(folder_, after)));
  std::error_code ignored;
  fs::remove(set_path_of(folder_, before), ignored);
  return {};
}

Status StreamEncoder::reopen() {
  if (!trainer_->has_bounds())
    return usage_error("{}: no window has been encoded", recording_path());
  recorder_.reset();
  STGS_ASSIGN(recorder_, SceneRecorder::resume(recording_path(), record_settings()));
  return {};
}

Status StreamEncoder::close() {
  if (frames() == 0) return usage_error("{}: no window has been encoded", recording_path());
  return recorder_->close();
}

Status StreamEncoder::finish(const std::string& output) {
  if (frames() == 0) return usage_error("{}: no window has been encoded", output);
  recorder_.reset();
  // Checked before the output is replaced.
  const std::string checked = folder_ + "/finished.stgs";
  for (const std::string& path : {checked, output}) {
    STGS_ASSIGN(std::unique_ptr<ByteSource> recording, open_file(recording_path()));
    DamageReport damage;
    STGS_TRY(finalize_scene(std::move(recording), path, damage));
    if (damage.any())
      return io_error("{}: damaged while it was written; check the disk", recording_path());
  }
  std::error_code ignored;
  fs::remove(checked, ignored);
  return {};
}

void StreamEncoder::remove_files() {
  recorder_.reset();
  std::error_code ignored;
  // The recording first: without it, the rest is no run to resume. The identity last: it marks the
  // folder as one of a run.
  fs::remove(recording_path(), ignored);
  std::vector<fs::path> others;
  fs::directory_iterator entries(folder_, ignored);
  for (; !ignored && entries != fs::directory_iterator(); entries.increment(ignored)) {
    if (entries->path() != fs::path(identity_path_of(folder_))) others.push_back(entries->path());
  }
  for (const fs::path& path : others) fs::remove_all(path, ignored);
  fs::remove_all(folder_, ignored);
}

}  // namespace stgs::encoder
