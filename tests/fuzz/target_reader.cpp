// SPDX-License-Identifier: Apache-2.0
// Other uses of a file than opening and decoding it: an index on demand, growth, damaged segments,
// recovery, statistics, and the continuation of a recording.
#include <atomic>
#include <cstring>
#include <memory_resource>
#include <string>

#include "../fixtures/file_bytes.h"
#include "../fixtures/fragment_fixture.h"
#include "../fixtures/temporary_folder.h"
#include "stgs/format/damage_report.h"
#include "stgs/format/decoder_model.h"
#include "stgs/format/scene_statistics.h"
#include "stgs_file.h"

using namespace stgs;
using namespace stgs::fuzz;

namespace {

// The beginning of a file, which grows and is cut off again.
class GrowingSource final : public ByteSource {
 public:
  GrowingSource(const Bytes& bytes, std::uint64_t size) : bytes_(bytes), size_(size), next_(size) {}

  void grow(std::uint64_t size) { next_ = size; }
  std::uint64_t size() const override { return size_; }
  bool may_grow() const override { return true; }
  Result<Change> refresh(std::uint64_t) override {
    const bool is_same = next_ == size_;
    size_ = next_;
    return is_same ? Change::kNone : Change::kResized;
  }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    STGS_TRY(check_range(name_, size_, offset, out.size()));
    std::copy_n(bytes_.begin() + static_cast<std::ptrdiff_t>(offset), out.size(), out.begin());
    return {};
  }
  const std::string& name() const override { return name_; }

 private:
  const Bytes& bytes_;
  std::uint64_t size_, next_;
  const std::string name_ = "input";
};

// Bytes of which some cannot be read: the reads from `first` to `last`, counted from 1.
class FailingSource final : public ByteSource {
 public:
  FailingSource(const Bytes& bytes, int first, int last)
      : bytes_(bytes), first_(first), last_(last) {}

  std::uint64_t size() const override { return bytes_.size(); }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    STGS_TRY(check_range(name_, bytes_.size(), offset, out.size()));
    const int read = ++reads_;
    if (read >= first_ && read <= last_) return io_error("{}: cannot read", name_);
    std::copy_n(bytes_.begin() + static_cast<std::ptrdiff_t>(offset), out.size(), out.begin());
    return {};
  }
  const std::string& name() const override { return name_; }

 private:
  const Bytes& bytes_;
  const int first_, last_;
  mutable std::atomic<int> reads_{0};
  const std::string name_ = "input";
};

const testing::TemporaryFolder& folder() {
  static const testing::TemporaryFolder made;
  return made;
}

// Recordings that grow, and that are closed.
std::vector<Bytes> seeds() {
  std::vector<Bytes> out = stgs_seeds();
  for (const Profile profile : {Profile::kLossless, Profile::kQuantised}) {
    const std::string path = folder() / "seed.stgs";
    {
      auto recorder = SceneRecorder::create(path, testing::recording_metadata(), 1,
                                            testing::recording_settings(profile));
      require(recorder.ok(), "a recording can be created");
      for (std::uint32_t i = 0; i < 4; ++i) {
        require((*recorder)
                    ->append(testing::make_fragment(i, 8), (i + 1) * testing::kFragmentFrames)
                    .ok(),
                "a recording can be continued");
        if (i == 2) out.push_back(testing::bytes_of(path));
      }
      require((*recorder)->close().ok(), "a recording can be closed");
    }
    out.push_back(testing::bytes_of(path));
    std::remove(path.c_str());
  }
  return out;
}

std::uint64_t memory(View input) {
  // Two readers of the file, the scene and the continued recording.
  return 2 * stgs_memory(input) + (1 << 20);
}

bool same_bits(const FloatArray& a, const FloatArray& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}

void check_segments(const SceneReader& reader) {
  for (std::uint32_t i = 0; i < reader.segments().size(); ++i) {
    const TimeOrigin origin = reader.render_origin(i);
    const auto full = reader.decode(i, true, origin);
    Status sh_status;
    const auto intact = reader.decode_intact(i, sh_status, origin);
    const auto placement = reader.decode_placement(i);
    const auto coded = reader.read(i, true, origin);
    if (!full.ok()) continue;
    require(intact.ok() && sh_status.ok() && same_bits(full->position, intact->position) &&
                same_bits(full->sh, intact->sh),
            "the intact content of a segment that decodes is the segment");
    require(placement.ok() && coded.ok(), "a segment that decodes has placements and bytes");
  }
}

void check_loading(const Bytes& input, const SceneReader& complete) {
  const double frames = complete.metadata().frames;
  auto reader = SceneReader::open(memory_source(input, "input"), kStgsLimits,
                                  std::pmr::get_default_resource(), IndexLoading::kOnDemand);
  if (!reader.ok()) return;
  std::size_t loaded = 0;
  for (const double ticks : {0.0, frames * 0.75, frames * 0.5}) {
    auto copy = (*reader)->loaded(memory_source(input, "input"), ticks, ticks);
    if (!copy.ok()) return;
    require((*copy)->is_loaded(ticks, ticks), "the loaded time is loaded");
    require((*copy)->segments().size() >= loaded, "loading adds segments");
    loaded = (*copy)->segments().size();
    reader = std::move(copy);
  }
  if (!(*reader)->load(0, frames).ok()) return;
  (void)(*reader)->unloaded();
  (void)(*reader)->complete_ticks();
  (void)(*reader)->latest_begin_ticks();
  (void)(*reader)->chunk_ticks();
}

void check_growth(const Bytes& input) {
  auto source = std::make_unique<GrowingSource>(input, input.size() / 2);
  GrowingSource& grown = *source;
  auto reader = SceneReader::open(std::move(source), kStgsLimits);
  if (!reader.ok()) return;
  for (const std::size_t size : {input.size() * 3 / 4, input.size(), input.size() / 2}) {
    grown.grow(size);
    const std::size_t before = (*reader)->segments().size();
    const auto changed = (*reader)->refresh();
    require((*reader)->segments().size() >= before, "a file that grows keeps its segments");
    if (!changed.ok()) return;
  }
  (void)(*reader)->refreshed(memory_source(input, "input"));
}

void check_recovery(const Bytes& input, const SceneReader& reader) {
  DamageReport report;
  const auto recovered = recover_scene(reader, "input", report, kStgsLimits);
  (void)describe_damage(report, reader.metadata().time_base);
  const auto scene = read_scene(memory_source(input, "input"), kStgsLimits);
  if (scene.ok()) {
    require(recovered.ok() && recovered->gaussians.size() == scene->gaussians.size(),
            "a scene that can be read can be recovered");
    const SceneStatistics statistics = scene_statistics(*scene);
    require(statistics.primitives == scene->gaussians.size(), "the statistics cover the scene");
  }
}

bool is_failure_of_input(const Status& status) {
  const StatusCode code = status.code();
  return code == StatusCode::kInvalidFile || code == StatusCode::kUnsupported ||
         code == StatusCode::kNotBuilt || code == StatusCode::kIo || code == StatusCode::kUsage;
}

// Reads everything that a source with these limits gives. Failures are those of the input.
void read_all(const Bytes& input, const ReadLimits& limits, int first_failure, int last_failure) {
  const auto source = [&] {
    return std::make_unique<FailingSource>(input, first_failure, last_failure);
  };
  const auto issues = validate_scene(*source(), limits);
  require(issues.ok() || is_failure_of_input(issues.status()), "validation fails for a reason");
  for (const IndexLoading loading : {IndexLoading::kComplete, IndexLoading::kOnDemand}) {
    const auto reader =
        SceneReader::open(source(), limits, std::pmr::get_default_resource(), loading);
    if (!reader.ok()) {
      require(is_failure_of_input(reader.status()), "opening fails for a reason of the input");
      continue;
    }
    (void)(*reader)->load(0, (*reader)->metadata().frames);
    (void)(*reader)->importance();
    (void)(*reader)->missing_bytes();
    (void)(*reader)->error_bounds();
    (void)(*reader)->tables();
    DamageReport report;
    const auto scene = recover_scene(**reader, "input", report, limits);
    require(scene.ok() || is_failure_of_input(scene.status()), "recovery fails for a reason");
  }
}

void check_limits_and_failures(const Bytes& input) {
  for (const std::uint64_t bytes : {400, 2000, 8000}) {
    read_all(input, {bytes / 100, bytes, bytes}, 0, 0);
    read_all(input, {kStgsLimits.max_primitives, bytes, 0}, 0, 0);
  }
  for (const int first : {1, 2, 3, 4, 6, 9}) {
    read_all(input, kStgsLimits, first, first);
    read_all(input, kStgsLimits, first, 1 << 30);
  }
}

// Reads the file by path, and finishes or continues a recording.
void check_file(const Bytes& input) {
  const std::string path = folder() / "input.stgs", finished = folder() / "finished.stgs";
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(input.data()),
             static_cast<std::streamsize>(input.size()));
  (void)scene_extras(path, kStgsLimits);
  DamageReport report;
  const Status finalized =
      finalize_scene(memory_source(input, "input"), finished, report, kStgsLimits);
  if (finalized.ok()) {
    require(SceneReader::open(finished, kStgsLimits).ok(), "a finished recording can be opened");
  }
  const auto reader = SceneReader::open(path, kStgsLimits);
  if (!reader.ok()) return;
  (void)profile_name((*reader)->profile());
  if ((*reader)->form() != SceneForm::kGrowing) return;
  auto recorder = SceneRecorder::resume(path, testing::recording_settings((*reader)->profile()));
  if (!recorder.ok()) return;
  const std::uint32_t frames = (*recorder)->frames();
  if (frames > 1u << 30) return;
  (void)(*recorder)->append(testing::make_fragment(0, 8), frames + testing::kFragmentFrames);
  (void)(*recorder)->close();
}

}  // namespace

const Target stgs::fuzz::kTarget{"reader", seeds, nullptr, repair_stgs, stgs_units, memory};

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const Bytes input(data, data + size);
  check_growth(input);
  check_limits_and_failures(input);
  check_file(input);
  const auto reader = SceneReader::open(memory_source(input, "input"), kStgsLimits);
  if (!reader.ok()) return 0;
  (void)decoder_needs(**reader);
  check_segments(**reader);
  check_loading(input, **reader);
  check_recovery(input, **reader);
  return 0;
}
