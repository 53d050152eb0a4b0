// SPDX-License-Identifier: Apache-2.0
// Recordings, complete, truncated and damaged: finalizing and resuming.
#include "../fixtures/file_bytes.h"
#include "../fixtures/fragment_fixture.h"
#include "packed_files.h"
#include "stgs/format/scene_recorder.h"
#include "stgs_file.h"

using namespace stgs;
using namespace stgs::fuzz;

namespace {

Bytes recording(Profile profile, std::uint32_t fragments, bool close) {
  const std::string path = input_folder().beside("seed.stgs");
  std::remove(path.c_str());
  auto recorder = SceneRecorder::create(path, testing::recording_metadata(), 1,
                                        testing::recording_settings(profile));
  require(recorder.ok(), "seeds can be written");
  for (std::uint32_t i = 0; i < fragments; ++i) {
    require(
        (*recorder)->append(testing::make_fragment(i, 12), (i + 1) * testing::kFragmentFrames).ok(),
        "seeds can be written");
  }
  if (close) require((*recorder)->close().ok(), "seeds can be written");
  return testing::bytes_of(path);
}

// A recording whose last fragment ends primitives of the first one.
Bytes recording_with_ends() {
  const std::string path = input_folder().beside("seed.stgs");
  std::remove(path.c_str());
  RecordSettings settings = testing::recording_settings(Profile::kLossless);
  settings.ends = true;
  auto recorder = SceneRecorder::create(path, testing::recording_metadata(), 1, settings);
  require(recorder.ok(), "seeds can be written");
  const Gaussians4D set = testing::make_fragment(0, 12);
  const FragmentPart parts[] = {{set, {}, 100}};
  std::vector<std::vector<StoredPrimitive>> stored;
  require((*recorder)->append(parts, {}, 10, &stored).ok(), "seeds can be written");
  const PrimitiveEnd ends[] = {{stored[0][0], 12}, {stored[0][1], 12}, {stored[0][2], 15}};
  require((*recorder)->append({}, ends, 20).ok(), "seeds can be written");
  return testing::bytes_of(path);
}

std::vector<Bytes> seeds() {
  std::vector<Bytes> out = {recording(Profile::kLossless, 0, false),
                            recording(Profile::kLossless, 3, false),
                            recording(Profile::kQuantised, 2, false),
                            recording(Profile::kQuantised, 2, true), recording_with_ends()};
  Bytes cut = out[1];
  cut.resize(cut.size() - 100);
  out.push_back(cut);
  return out;
}

// The memory of reading, three times: the input, the finished file, and a resumed recording.
std::uint64_t memory(View input) {
  return 3 * stgs_memory(input);
}

bool has_errors(const ByteSource& file) {
  const auto issues = validate_scene(file, kStgsLimits);
  require(issues.ok(), "validation runs on every file");
  return std::any_of(issues->begin(), issues->end(),
                     [](const Issue& issue) { return issue.error; });
}

void finalize(const Bytes& input) {
  const std::string output = input_folder().beside("finished.stgs");
  std::remove(output.c_str());
  DamageReport report;
  const Status status = finalize_scene(memory_source(input, "input"), output, report, kStgsLimits);
  if (!status.ok()) {
    require(!std::ifstream(output).good(), "a failed conversion writes nothing");
    require(!status.message().empty(), "an error has a message");
    return;
  }
  const auto reader = SceneReader::open(output, kStgsLimits);
  require(reader.ok(), "a finished file can be opened");
  const Bytes finished = testing::bytes_of(output);
  require(report.any() || has_errors(*memory_source(input, "input")) ||
              !has_errors(*memory_source(finished, "finished")),
          "a valid recording gives a valid file");
  DamageReport again;
  require(!finalize_scene(memory_source(finished, "finished"), input_folder().beside("again.stgs"),
                          again, kStgsLimits)
                  .ok() ||
              !report.damage.empty(),
          "a finished file is not finalized again");
}

void resume(const Bytes& input) {
  const std::string path = input_folder().beside("resumed.stgs");
  write_input(path, {reinterpret_cast<const char*>(input.data()), input.size()});
  std::uint32_t frames = 0;
  {
    auto recorder = SceneRecorder::resume(path, testing::recording_settings(Profile::kLossless));
    if (!recorder.ok()) {
      require(testing::bytes_of(path) == input, "a failed call leaves the file unchanged");
      return;
    }
    frames = (*recorder)->frames();
    if (frames > (1u << 30) || (*recorder)->sh_degree() != 1) return;
    const std::uint64_t before = (*recorder)->bytes();
    require(before <= input.size(), "a recording is resumed within its file");
    const Status added =
        (*recorder)->append(testing::make_fragment(7, 8), frames + testing::kFragmentFrames);
    if (!added.ok()) {
      require((*recorder)->bytes() == before && !added.message().empty(),
              "a rejected fragment changes nothing");
      return;
    }
  }
  const auto reader = SceneReader::open(path, ReadLimits{40'000, 512 << 10});
  require(!reader.ok() || (*reader)->metadata().frames == frames + testing::kFragmentFrames,
          "the appended fragment is in the file");
}

}  // namespace

const Target stgs::fuzz::kTarget{"recording", seeds, nullptr, repair_stgs, stgs_units, memory};

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const Bytes input(data, data + size);
  finalize(input);
  resume(input);
  return 0;
}
