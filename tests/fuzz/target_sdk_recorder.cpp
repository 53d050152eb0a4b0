// SPDX-License-Identifier: Apache-2.0
// Recording by the C interface, in whatever order of calls and with whatever numbers the input
// says. What is appended is there at once, whole and sound; what is refused leaves the file as it
// was.
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>

#include "../api/temporary_folder.h"
#include "choices.h"
#include "stgs/stgs_encoder.h"

using namespace stgs;
using namespace stgs::fuzz;
namespace fs = std::filesystem;

namespace {

constexpr std::size_t kArrays = 10;
enum Call : std::uint8_t { kMake, kBegin, kResume, kAppend, kAppendToo, kClose, kEnd, kCut };

// Of an input: calls one after the other, with the choices that each makes.
class Program {
 public:
  Program& call(Call what) { return add({what}); }
  Program& start(Call how, Bytes changes = {0}) {
    return call(how).add(changes).add({0, 0});  // of this header, a.stgs
  }
  Program& append(std::uint8_t count, std::uint8_t length, std::uint8_t left_out) {
    return call(kAppend).add({count, 5, length, 0, left_out}).add(Bytes(kArrays + 2));
  }
  Program& add(const Bytes& bytes) {
    bytes_.insert(bytes_.end(), bytes.begin(), bytes.end());
    return *this;
  }
  Bytes bytes() const { return bytes_; }

 private:
  Bytes bytes_;
};

std::vector<Bytes> seeds() {
  return {Program()
              .call(kMake)
              .start(kBegin)
              .append(9, 1, 0)
              .append(0, 2, 0)
              .append(60, 2, 7)
              .call(kClose)
              .bytes(),
          // Of degree 1, left and cut, and gone on with; and again after it was closed.
          Program()
              .call(kMake)
              .start(kBegin, {1, 2, 8})
              .append(12, 2, 8)
              .append(20, 2, 4)
              .call(kEnd)
              .call(kCut)
              .add({9})
              .call(kMake)
              .start(kResume)
              .append(5, 1, 15)
              .call(kClose)
              .call(kMake)
              .start(kResume)
              .bytes(),
          // Many short stretches of nothing but one.
          Program()
              .call(kMake)
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

// Of a few dozen primitives.
std::uint64_t most_memory(View) {
  return 128 << 20;
}

std::string read_whole(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

class Calls {
 public:
  explicit Calls(View input) : choices_(input) {
    for (int k = 0; k < 24 && choices_.any_left(); ++k) call();
    stgs_recorder_destroy(recorder_);
  }

 private:
  void call() {
    switch (choices_.next() % 8) {
      case kMake:
        end();
        require(stgs_recorder_create(&recorder_) == STGS_OK, "a recorder is made");
        return;
      case kBegin:
        return start(stgs_recorder_begin);
      case kResume:
        return start(stgs_recorder_resume);
      case kClose:
        if (told(stgs_recorder_close(recorder_)) == STGS_OK) check_file();
        return;
      case kEnd:
        return end();
      case kCut:
        return cut();
      default:
        return append();
    }
  }

  void end() {
    stgs_recorder_destroy(recorder_);
    recorder_ = nullptr;
    path_.clear();
  }

  // As a process that is killed within an append leaves a file.
  void cut() {
    const std::string path = folder_ / "a.stgs";
    const std::size_t bytes = choices_.next();
    if (path == path_ || !fs::exists(path) || fs::file_size(path) < bytes) return;
    fs::resize_file(path, fs::file_size(path) - bytes);
  }

  stgs_result told(stgs_result result) const {
    require(std::string(stgs_result_name(result)) != "unknown result", "a result has a name");
    require(result != STGS_ERROR_RUNTIME, "what goes wrong is foreseen");
    stgs_error error{};
    error.struct_size = sizeof error;
    if (stgs_recorder_error(recorder_, &error) == STGS_OK) {
      require(error.result == result, "an error is the last call's");
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
          s.sh_degree = choices_.small() % 5;
          break;
        case 3:
          s.tiers = choices_.small();
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

  void start(stgs_result (*how)(stgs_recorder*, const char*, const stgs_record_settings*)) {
    const stgs_record_settings s = settings();
    OtherSize<stgs_record_settings> other(s, choices_.next());
    const std::uint8_t which = choices_.next();
    constexpr const char* kNames[] = {"a.stgs", "a.stgs", "b.stgs", "none/a.stgs", ""};
    const std::string path = folder_ / kNames[which % std::size(kNames)];
    if (told(how(recorder_, which == 77 ? nullptr : path.c_str(),
                 which % 16 == 1   ? nullptr
                 : which % 16 == 2 ? other.get()
                                   : &s)) == STGS_OK) {
      path_ = path;
      check_file();
    }
  }

  // Numbers as a capture has them, and one of the input's in their midst.
  void fill(std::vector<float>& values, std::size_t count, float least, float most) {
    std::uniform_real_distribution<float> between(least, most);
    values.resize(count);
    for (float& v : values) v = between(random_);
    if (choices_.next() % 8 == 1 && count > 0) {
      values[choices_.next() % count] = static_cast<float>(choices_.number());
    }
  }

  void append() {
    stgs_recorder_status status{};
    status.struct_size = sizeof status;
    const bool known = stgs_recorder_get_status(recorder_, &status) == STGS_OK;
    stgs_fragment s;
    require(stgs_fragment_defaults(&s, sizeof s) == STGS_OK, "a stretch has defaults");
    const std::size_t count = choices_.next() % 64;
    random_.seed(choices_.next());
    constexpr std::uint32_t kFrames[] = {1, 2, 15, 0, 100, 30'000, 1u << 31, UINT32_MAX};
    const std::uint8_t length = choices_.next();
    s.frames = kFrames[length % 3 == 0 ? length / 3 % std::size(kFrames) : length % 3];
    s.visible_frames = choices_.next() % 4 == 1 ? choices_.of(kFrames) : 0;
    const auto coefficients =
        static_cast<std::size_t>(3 * (status.sh_degree + 1) * (status.sh_degree + 1));
    struct {
      std::size_t floats;
      float least, most;
      const float* stgs_fragment::*member;
    } const arrays[kArrays] = {
        {3, -3, 3, &stgs_fragment::position},   {3, -1, 1, &stgs_fragment::velocity},
        {3, 0.001f, 1, &stgs_fragment::scale},  {4, -1, 1, &stgs_fragment::rotation},
        {1, 0, 1, &stgs_fragment::opacity},     {coefficients, -1, 1, &stgs_fragment::sh},
        {1, -0.1f, 0.6f, &stgs_fragment::time}, {1, 0.001f, 1, &stgs_fragment::sigma},
        {1, 0, 1, &stgs_fragment::radius},      {1, 0, 1, &stgs_fragment::importance}};
    std::vector<float> values[kArrays];
    const unsigned left_out = choices_.next();  // bits: velocity, rotation, lifespans, importance
    for (std::size_t a = 0; a < kArrays; ++a) {
      fill(values[a], arrays[a].floats * count, arrays[a].least, arrays[a].most);
      s.*arrays[a].member = values[a].data();
    }
    if ((left_out & 1) != 0) s.velocity = nullptr;
    if ((left_out & 2) != 0) s.rotation = nullptr;
    if ((left_out & 4) != 0) s.time = s.sigma = s.radius = nullptr;
    if ((left_out & 8) != 0) s.importance = nullptr;
    if ((left_out & 0xF0) == 0xF0) s.scale = nullptr;
    s.count = count;
    const std::string before = path_.empty() ? std::string() : read_whole(path_);
    OtherSize<stgs_fragment> other(s, choices_.next());
    const bool as_other = choices_.next() % 16 == 1;
    const stgs_result result = told(stgs_recorder_append(recorder_, as_other ? other.get() : &s));
    require(known || result != STGS_OK, "there is something to append to");
    if (result == STGS_OK) return check_file();
    if (!path_.empty()) require(read_whole(path_) == before, "what is refused changes nothing");
  }

  // That the file is what its recorder says, and can be read.
  void check_file() const {
    stgs_recorder_status status{};
    status.struct_size = sizeof status;
    require(stgs_recorder_get_status(recorder_, &status) == STGS_OK,
            "a recorder tells of its file");
    require(status.bytes == fs::file_size(path_), "a recorder knows its file's size");
    stgs_scene* scene = nullptr;
    require(stgs_scene_create(nullptr, &scene) == STGS_OK, "a scene is made");
    require(stgs_scene_open(scene, path_.c_str()) == STGS_OK, "a recording can be opened");
    stgs_scene_info info{};
    info.struct_size = sizeof info;
    require(stgs_scene_get_info(scene, &info) == STGS_OK, "a recording is told of");
    require(info.issues == 0, "a recording is sound");
    require(info.frames == std::max(1u, status.frames), "all of a recording is there");
    require(info.primitives == status.primitives, "a recorder knows how many primitives there are");
    require(info.sh_degree == status.sh_degree, "a recorder knows its file's degree");
    for (const double share : {0.0, 0.5, 1.0}) {
      std::uint64_t count = 0;
      require(stgs_scene_get_primitives(scene, share * info.duration_seconds, nullptr, &count) ==
                  STGS_OK,
              "a moment of a recording can be read");
      require(count <= info.primitives, "no more is seen than there is");
    }
    stgs_scene_destroy(scene);
  }

  Choices choices_;
  const testing::TemporaryFolder folder_;
  stgs_recorder* recorder_ = nullptr;
  std::string path_;  // of the recorder's file; empty: it has none
  std::mt19937 random_;
};

}  // namespace

const Target stgs::fuzz::kTarget{"sdk_recorder", seeds, nullptr, nullptr, nullptr, most_memory};

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Calls({data, std::min<std::size_t>(size, 512)});
  return 0;
}
