// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/stream_encoder.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <utility>

#include "pack/metadata.h"
#include "stgs/encoder/windows.h"
#include "stgs/format/damage_report.h"
#include "stgs/format/output_file.h"
#include "train/training_choice.h"

namespace stgs::encoder {
namespace {

namespace fs = std::filesystem;

// Frames for which persistent primitives are displayed: more than a capture has (kCaptureLimits).
constexpr std::uint32_t kPersistentFrames = 1u << 20;
constexpr std::uint64_t kMaxIdentityBytes = 1u << 20;

Result<std::string> read_text(const std::string& path) {
  STGS_ASSIGN(const std::unique_ptr<ByteSource> file, open_file(path));
  if (file->size() > kMaxIdentityBytes) return invalid_file("{}: damaged (too long)", path);
  std::string text(file->size(), '\0');
  STGS_TRY(file->read(0, {reinterpret_cast<std::uint8_t*>(text.data()), text.size()}));
  return text;
}

// Returns the primitives of part p of a scene.
Gaussians4D primitives_of(const Scene& scene, std::size_t p) {
  std::size_t first = 0;
  for (std::size_t k = 0; k < p; ++k) first += scene.parts[k].primitives;
  std::vector<std::uint32_t> members(scene.parts[p].primitives);
  for (std::size_t i = 0; i < members.size(); ++i)
    members[i] = static_cast<std::uint32_t>(first + i);
  return scene.gaussians.gather(members);
}

}  // namespace

std::string StreamEncoder::set_path(int frames) const {
  return fmt::format("{}/persistent-{:07}.set", folder_, frames);
}

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

// kUsage for settings with which windows cannot share content or be recorded.
Status check_settings(const StreamSettings& settings, const TrainingChoice& choice) {
  const Ablation& ablation = choice.ablation;
  if (!ablation.representation || !ablation.initialisation) {
    return usage_error(
        "windows share the static primitives of the method sharptimegs; train all frames at once "
        "with this method or ablation");
  }
  if (settings.resumable && settings.carries_moving)
    return usage_error(
        "a run that carries moving content cannot be resumable; set resumable to false");
  if (settings.pack.profile == Profile::kNearLossless) {
    return usage_error(
        "windows cannot be written in the profile {}, whose errors are known only at the end; "
        "encode all frames at once, or use the profile {}",
        profile_name(settings.pack.profile), profile_name(Profile::kQuantised));
  }
  return {};
}

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

Result<std::unique_ptr<StreamEncoder>> StreamEncoder::open(const std::string& folder,
                                                           const StreamSettings& settings) {
  STGS_TRY(check_training(settings.train, nullptr));
  STGS_TRY(check_packing(settings.pack));
  STGS_ASSIGN(const TrainingChoice choice, choose_training(settings.train));
  STGS_TRY(check_settings(settings, choice));
  STGS_ASSIGN(const std::uint64_t training, settings_id(settings.train));
  std::unique_ptr<StreamEncoder> encoder(new StreamEncoder(folder, settings));
  encoder->set_ = PersistentSet(settings.carries_moving);
  encoder->later_iterations_ = std::max(
      1, static_cast<int>(std::lround(settings.later_share * choice.parameters.iterations)));
  const std::string identity = fmt::format("stgs {}\ntraining {:016x}\nseed {}\n{}", STGS_VERSION,
                                           training, settings.train.seed, settings.identity);
  const std::string identity_path = folder + "/identity.txt";
  std::error_code ignored;
  if (!settings.resumable) {
    if (!fs::is_empty(folder, ignored))
      return usage_error("{}: contains other files; name a new or empty folder", folder);
    if (fs::exists(encoder->recording_path(), ignored))
      return usage_error("{}: exists; name another file", encoder->recording_path());
    return encoder;
  }
  if (!fs::exists(identity_path, ignored)) {
    if (!fs::is_empty(folder, ignored))
      return usage_error("{}: contains other files; name a new or empty folder", folder);
    STGS_TRY(write_file_atomically(
        identity_path, {reinterpret_cast<const std::uint8_t*>(identity.data()), identity.size()}));
    return encoder;
  }
  STGS_ASSIGN(const std::string found, read_text(identity_path));
  if (found != identity) {
    return usage_error(
        "{}: holds an incomplete encoding of another capture or with other settings; repeat its "
        "command to complete it, or remove the folder",
        folder);
  }
  // Without a set, the first window was not completed.
  STGS_ASSIGN(const std::vector<fs::path> sets, list_sets(folder));
  if (sets.empty()) {
    fs::remove(encoder->recording_path(), ignored);
    return encoder;
  }
  if (fs::exists(encoder->recording_path(), ignored))
    STGS_TRY(encoder->resume(sets.back().string()));
  return encoder;
}

Status StreamEncoder::resume(const std::string& newest_set) {
  STGS_ASSIGN(set_, PersistentSet::read(newest_set));
  STGS_ASSIGN(recorder_, SceneRecorder::resume(recording_path(), record_settings()));
  if (recorder_->bytes() > set_.recorded().bytes) {  // the set of the last fragment is missing
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
  take_bounds(first);
  // A killed process can leave the set of the window before.
  STGS_ASSIGN(const std::vector<fs::path> sets, list_sets(folder_));
  std::error_code ignored;
  for (const fs::path& path : sets) {
    if (path != newest_set) fs::remove(path, ignored);
  }
  return {};
}

void StreamEncoder::take_bounds(const PreparedCapture& first) {
  bounds_ = {first.near_plane, first.extent, first.scene_radius};
  std::copy_n(first.scene_centre, 3, bounds_->centre);
}

int StreamEncoder::frames() const {
  return recorder_ ? static_cast<int>(recorder_->frames()) : 0;
}

Result<StreamWindow> StreamEncoder::encode(const PreparedCapture& window,
                                           const ProgressSink& progress, const LogSink& log,
                                           const WindowWork& work) {
  try {
    return encode_window(window, progress, log, work);
  } catch (const std::exception& error) {
    return runtime_error("encoding the window after frame {} failed: {}", frames(), error.what());
  }
}

Result<StreamWindow> StreamEncoder::encode_window(PreparedCapture window,
                                                  const ProgressSink& progress, const LogSink& log,
                                                  const WindowWork& work) {
  StreamWindow out;
  out.first_frame = frames();
  out.frames = window.frames;
  TrainSettings train_settings = settings_.train;
  if (work.max_seconds > 0) train_settings.max_seconds = work.max_seconds;
  if (work.keep > 0)
    train_settings.overrides.emplace_back("compact_keep", fmt::format("{:.6f}", work.keep));
  if (frames() > 0 || work.iterations > 0) {
    train_settings.iterations = work.iterations > 0 ? work.iterations : later_iterations_;
    std::erase_if(train_settings.overrides,
                  [](const auto& entry) { return entry.first == "iterations"; });
  }
  if (bounds_) {
    window.near_plane = bounds_->near_plane;
    window.extent = bounds_->extent;
    window.scene_radius = bounds_->radius;
    std::copy_n(bounds_->centre, 3, window.scene_centre);
  } else {
    // A resumed run reads the bounds from it.
    PreparedCapture first = window;
    first.folder = folder_;
    STGS_TRY(write_prepared_capture(first));
    take_bounds(first);
  }
  PersistentSet set = set_;
  STGS_ASSIGN(const Scene scene,
              train(window, train_settings, progress, log, &out.training, {&set, &backend_}));
  if (!recorder_) STGS_TRY(create_recording(scene));
  const std::uint64_t bytes = recorder_->bytes(), primitives = recorder_->primitives();
  const int before = frames(), after = before + window.frames;
  STGS_TRY(append(scene, window.frames, set));
  // After the fragment, which a resumed run encodes again if it lacks the set.
  if (settings_.resumable) STGS_TRY(set.write(set_path(after)));
  set_ = std::move(set);
  std::error_code ignored;
  fs::remove(set_path(before), ignored);
  out.primitives = recorder_->primitives() - primitives;
  out.persistent = set_.size();
  out.ended = set_.ends().size();
  out.bytes = recorder_->bytes() - bytes;
  return out;
}

Status StreamEncoder::create_recording(const Scene& scene) {
  SceneMetadata metadata = scene.metadata;
  metadata.window.reset();
  metadata.title = settings_.title;
  STGS_TRY(apply_metadata(settings_.pack, metadata));
  STGS_ASSIGN(recorder_, SceneRecorder::create(recording_path(), metadata,
                                               scene.gaussians.sh_degree, record_settings()));
  return {};
}

Status StreamEncoder::append(const Scene& scene, int frames, PersistentSet& set) {
  const Gaussians4D moving = primitives_of(scene, 0), persistent = primitives_of(scene, 1);
  const std::span<const float> importance = scene.importance;
  const auto begin = static_cast<std::uint32_t>(this->frames());
  // The first part with primitives determines the chunk of the file.
  FragmentPart parts[] = {{moving}, {persistent, {}, begin + kPersistentFrames}};
  if (!importance.empty()) {
    parts[0].importance = importance.first(moving.size());
    parts[1].importance = importance.subspan(moving.size());
  }
  if (scene.quantisation && settings_.pack.quality == 0) {
    for (FragmentPart& part : parts) part.quality = scene.quantisation->quality;
    if (moving.size() > 0) parts[0].steps = &*scene.quantisation;
  }
  // Primitives are displayed in the frame of their end.
  std::vector<PrimitiveEnd> ends = set.ends();
  std::erase_if(ends, [](const PrimitiveEnd& end) { return end.primitive.record == 0; });
  for (PrimitiveEnd& end : ends) end.frame += begin - 1;
  std::vector<std::vector<StoredPrimitive>> stored;
  STGS_TRY(recorder_->append(parts, ends, begin + static_cast<std::uint32_t>(frames), &stored));
  set.set_recorded(stored[1], recorder_->bytes());
  return {};
}

Status StreamEncoder::skip(int frames) {
  if (!recorder_) return usage_error("{}: no window has been encoded", recording_path());
  const int before = this->frames(), after = before + frames;
  STGS_TRY(recorder_->append(std::span<const FragmentPart>(), static_cast<std::uint32_t>(after)));
  set_ = set_.without_moving();
  set_.set_recorded({}, recorder_->bytes());
  if (settings_.resumable) STGS_TRY(set_.write(set_path(after)));
  std::error_code ignored;
  fs::remove(set_path(before), ignored);
  return {};
}

Status StreamEncoder::reopen() {
  if (!bounds_) return usage_error("{}: no window has been encoded", recording_path());
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
  // The recording first: without it, the rest is no run to resume.
  fs::remove(recording_path(), ignored);
  fs::remove_all(folder_, ignored);
}

}  // namespace stgs::encoder
