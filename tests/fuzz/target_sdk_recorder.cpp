// SPDX-License-Identifier: Apache-2.0
// Recording through the C interface, in the order of calls and with the numbers of the input.
// Appended fragments can be read at once; a rejected call leaves the file unchanged.
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>

#include "../fixtures/temporary_folder.h"
#include "choices.h"
#include "stgs/stgs_encoder.h"

using namespace stgs;
using namespace stgs::fuzz;
namespace fs = std::filesystem;

namespace {

constexpr std::size_t kArrays = 10;
// The corpus depends on these numbers.
enum Call : std::uint8_t {
  kCreate,
  kBegin,
  kResume,
  kAppend,
  kAppendAlias,
  kClose,
  kDestroy,
  kTruncate
};

// Builds an input: calls in order, each with the choices that it makes.
class InputBuilder {
 public:
  InputBuilder& call(Call number) { return add({number}); }
  InputBuilder& start(Call number, Bytes changes = {0}) {
    return call(number).add(changes).add({0, 0});  // settings of this version, a.stgs
  }
  InputBuilder& append(std::uint8_t count, std::uint8_t length, std::uint8_t omitted) {
    return call(kAppend).add({count, 5, length, 0, omitted}).add(Bytes(kArrays + 2));
  }
  InputBuilder& add(const Bytes& bytes) {
    bytes_.insert(bytes_.end(), bytes.begin(), bytes.end());
    return *this;
  }
  Bytes bytes() const { return bytes_; }

 private:
  Bytes bytes_;
};

std::vector<Bytes> seeds() {
  return {InputBuilder()
              .call(kCreate)
              .start(kBegin)
              .append(9, 1, 0)
              .append(0, 2, 0)
              .append(60, 2, 7)
              .call(kClose)
              .bytes(),
          // SH degree 1: destroyed, truncated and resumed, then resumed again after close().
          InputBuilder()
              .call(kCreate)
              .start(kBegin, {1, 2, 8})
              .append(12, 2, 8)
              .append(20, 2, 4)
              .call(kDestroy)
              .call(kTruncate)
              .add({9})
              .call(kCreate)
              .start(kResume)
              .append(5, 1, 15)
              .call(kClose)
              .call(kCreate)
              .start(kResume)
              .bytes(),
          // Many short fragments, most of them empty.
          InputBuilder()
              .call(kCreate)
              .start(kBegin)
              .append(1, 1, 0)
              .append(0, 1, 0)
              .append(0, 1, 0)
              .append(0, 1, 0)
              .append(0, 1, 0)
              .append(0, 1, 0)
              .append(0, 1, 0)
              .append(1, 1, 7)
              .bytes()};
}

// Covers a few dozen primitives.
std::uint64_t max_memory(View) {
  return 128 << 20;
}

std::string read_file(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

class RecorderCalls {
 public:
  explicit RecorderCalls(View input) : choices_(input) {
    for (int k = 0; k < 24 && choices_.has_more(); ++k) call();
    stgs_recorder_destroy(recorder_);
  }

 private:
  void call() {
    switch (choices_.next() % 8) {
      case kCreate:
        destroy();
        require(stgs_recorder_create(&recorder_) == STGS_OK, "a recorder can be created");
        return;
      case kBegin:
        return start(stgs_recorder_begin);
      case kResume:
        return start(stgs_recorder_resume);
      case kClose:
        if (check(stgs_recorder_close(recorder_)) == STGS_OK) check_file();
        return;
      case kDestroy:
        return destroy();
      case kTruncate:
        return truncate();
      default:
        return append();
    }
  }

  void destroy() {
    stgs_recorder_destroy(recorder_);
    recorder_ = nullptr;
    path_.clear();
  }

  // Truncates the file, as a process that is killed during an append leaves it.
  void truncate() {
    const std::string path = folder_ / "a.stgs";
    const std::size_t bytes = choices_.next();
    if (path == path_ || !fs::exists(path) || fs::file_size(path) < bytes) return;
    fs::resize_file(path, fs::file_size(path) - bytes);
  }

  stgs_result check(stgs_result result) const {
    require(std::string(stgs_result_name(result)) != "unknown result", "a result has a name");
    require(result != STGS_ERROR_RUNTIME, "no call fails with an unspecified error");
    stgs_error error{};
    error.struct_size = sizeof error;
    if (stgs_recorder_error(recorder_, &error) == STGS_OK) {
      require(error.result == result, "the error is that of the last call");
      require((result == STGS_OK) == (error.message[0] == '\0'), "an error has a message");
    }
    return result;
  }

  stgs_record_settings settings() {
    stgs_record_settings s;
    require(stgs_record_settings_defaults(&s, sizeof s) == STGS_OK, "settings have defaults");
    s.sync = 0;
    double stgs_record_settings::*const numbers[] = {
        &stgs_record_settings::quality, &stgs_record_settings::max_error,
        &stgs_record_settings::chunk_seconds, &stgs_record_settings::metres_per_unit,
        &stgs_record_settings::audio_begin};
    for (int changes = choices_.next() % 4; changes > 0; --changes) {
      switch (choices_.next() % 8) {
        case 0:
          s.time_base_numerator = choices_.count();
          break;
        case 1:
          s.time_base_denominator = choices_.count();
          break;
        case 2:
          s.sh_degree = choices_.small_int() % 5;
          break;
        case 3:
          s.tiers = choices_.small_int();
          break;
        case 4:
          s.up[choices_.next() % 3] = static_cast<float>(choices_.number());
          break;
        case 5:
          s.threads = choices_.count();
          break;
        default:
          s.*numbers[choices_.next() % std::size(numbers)] = choices_.number();
          break;
      }
    }
    return s;
  }

  void start(stgs_result (*begin)(stgs_recorder*, const char*, const stgs_record_settings*)) {
    const stgs_record_settings s = settings();
    ResizedStruct<stgs_record_settings> resized(s, choices_.next());
    const std::uint8_t kind = choices_.next();
    constexpr const char* kNames[] = {"a.stgs", "a.stgs", "b.stgs", "none/a.stgs", ""};
    const std::string path = folder_ / kNames[kind % std::size(kNames)];
    if (check(begin(recorder_, kind == 77 ? nullptr : path.c_str(),
                    kind % 16 == 1   ? nullptr
                    : kind % 16 == 2 ? resized.get()
                                     : &s)) == STGS_OK) {
      path_ = path;
      check_file();
    }
  }

  // Fills an array with plausible numbers, sometimes with one that interfaces mishandle.
  void fill(std::vector<float>& values, std::size_t count, float low, float high) {
    std::uniform_real_distribution<float> between(low, high);
    values.resize(count);
    for (float& v : values) v = between(random_);
    if (choices_.next() % 8 == 1 && count > 0) {
      values[choices_.next() % count] = static_cast<float>(choices_.number());
    }
  }

  void append() {
    stgs_recorder_status status{};
    status.struct_size = sizeof status;
    const bool has_file = stgs_recorder_get_status(recorder_, &status) == STGS_OK;
    stgs_fragment s;
    require(stgs_fragment_defaults(&s, sizeof s) == STGS_OK, "a fragment has defaults");
    const std::size_t count = choices_.next() % 64;
    random_.seed(choices_.next());
    constexpr std::uint32_t kFrames[] = {1, 2, 15, 0, 100, 30'000, 1u << 31, UINT32_MAX};
    const std::uint8_t length = choices_.next();
    s.frames = kFrames[length % 3 == 0 ? length / 3 % std::size(kFrames) : length % 3];
    s.visible_frames = choices_.next() % 4 == 1 ? choices_.pick(kFrames) : 0;
    const auto coefficients =
        static_cast<std::size_t>(3 * (status.sh_degree + 1) * (status.sh_degree + 1));
    struct {
      std::size_t floats;
      float low, high;
      const float* stgs_fragment::*member;
    } const arrays[kArrays] = {
        {3, -3, 3, &stgs_fragment::position},   {3, -1, 1, &stgs_fragment::velocity},
        {3, 0.001f, 1, &stgs_fragment::scale},  {4, -1, 1, &stgs_fragment::rotation},
        {1, 0, 1, &stgs_fragment::opacity},     {coefficients, -1, 1, &stgs_fragment::sh},
        {1, -0.1f, 0.6f, &stgs_fragment::time}, {1, 0.001f, 1, &stgs_fragment::sigma},
        {1, 0, 1, &stgs_fragment::radius},      {1, 0, 1, &stgs_fragment::importance}};
    std::vector<float> values[kArrays];
    const unsigned omitted = choices_.next();  // bits: velocity, rotation, lifespans, importance
    for (std::size_t a = 0; a < kArrays; ++a) {
      fill(values[a], arrays[a].floats * count, arrays[a].low, arrays[a].high);
      s.*arrays[a].member = values[a].data();
    }
    if ((omitted & 1) != 0) s.velocity = nullptr;
    if ((omitted & 2) != 0) s.rotation = nullptr;
    if ((omitted & 4) != 0) s.time = s.sigma = s.radius = nullptr;
    if ((omitted & 8) != 0) s.importance = nullptr;
    if ((omitted & 0xF0) == 0xF0) s.scale = nullptr;
    s.count = count;
    const std::string before = path_.empty() ? std::string() : read_file(path_);
    ResizedStruct<stgs_fragment> resized(s, choices_.next());
    const bool as_resized = choices_.next() % 16 == 1;
    const stgs_result result =
        check(stgs_recorder_append(recorder_, as_resized ? resized.get() : &s));
    require(has_file || result != STGS_OK, "only an open recording can be appended to");
    if (result == STGS_OK) return check_file();
    if (!path_.empty())
      require(read_file(path_) == before, "a rejected fragment leaves the file unchanged");
  }

  // Checks that the file can be read and matches the status of its recorder.
  void check_file() const {
    stgs_recorder_status status{};
    status.struct_size = sizeof status;
    require(stgs_recorder_get_status(recorder_, &status) == STGS_OK,
            "an open recorder has a status");
    require(status.bytes == fs::file_size(path_), "the status has the size of the file");
    stgs_scene* scene = nullptr;
    require(stgs_scene_create(nullptr, &scene) == STGS_OK, "a scene can be created");
    require(stgs_scene_open(scene, path_.c_str()) == STGS_OK, "a recording can be opened");
    stgs_scene_info info{};
    info.struct_size = sizeof info;
    require(stgs_scene_get_info(scene, &info) == STGS_OK, "a recording has information");
    require(info.issues == 0, "a recording has no issues");
    require(info.frames == std::max(1u, status.frames), "a recording has all its frames");
    require(info.primitives == status.primitives, "the status has the number of primitives");
    require(info.sh_degree == status.sh_degree, "the status has the SH degree");
    for (const double fraction : {0.0, 0.5, 1.0}) {
      std::uint64_t count = 0;
      require(stgs_scene_get_primitives(scene, fraction * info.duration_seconds, nullptr, &count) ==
                  STGS_OK,
              "every time of a recording can be read");
      require(count <= info.primitives, "the visible primitives are among the stored ones");
    }
    stgs_scene_destroy(scene);
  }

  Choices choices_;
  const testing::TemporaryFolder folder_;
  stgs_recorder* recorder_ = nullptr;
  std::string path_;  // of the open file; empty: none
  std::mt19937 random_;
};

}  // namespace

const Target stgs::fuzz::kTarget{"sdk_recorder", seeds, nullptr, nullptr, nullptr, max_memory};

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  RecorderCalls({data, std::min<std::size_t>(size, 512)});
  return 0;
}
