// SPDX-License-Identifier: Apache-2.0
// The encoder's C interface, called in whatever order and with whatever arguments the input says,
// over a tiny capture and files of its own that may be damaged. Every result is one that the header
// names, what fails says why and leaves all files as they were, and what succeeds can be opened.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>
#include <limits>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <thread>

#include "../api/synthetic_capture.h"
#include "../api/temporary_folder.h"
#include "choices.h"
#include "fuzz_target.h"
#include "sdk_hooks.h"
#include "stgs/encoder/train.h"
#include "stgs/stgs_encoder.h"

using namespace stgs;
using namespace stgs::fuzz;
namespace fs = std::filesystem;

namespace {

std::vector<Bytes> seeds() {
  return {// Make; check, train and pack what was trained; end.
          {0, 0, 0, 4, 0, 0, 0, 5, 0, 0, 0, 0, 0, 0, 6, 0, 0, 0, 1, 1, 0, 0, 1, 0, 1, 0},
          // With parameters, and with what the pictures lose.
          {0, 2, 1, 5, 1, 15, 0, 5,  1, 6, 2, 0, 0, 0, 0, 0,
           0, 6, 2, 5, 0, 6,  0, 15, 0, 0, 1, 0, 0, 0, 1, 0},
          // A run that is stopped, with its checkpoint, and goes on; two scenes for one.
          {0, 3, 1, 3, 1, 5, 1, 8, 3, 0, 0, 0, 0, 0, 5, 1, 10,
           3, 0, 0, 0, 0, 0, 6, 0, 0, 0, 2, 0, 1, 0, 1, 0},
          // A damaged scene, a damaged checkpoint, and a call that is cancelled from beside.
          {0, 1, 1, 8, 0, 77, 6,  0, 9, 6, 0, 0, 0, 1, 0, 0, 0, 1, 0, 8, 1,
           9, 1, 0, 3, 5, 1,  10, 2, 0, 0, 0, 0, 0, 2, 5, 0, 0, 0, 0, 0, 0},
          {0, 0, 0, 7, 0, 0, 0, 0, 0, 0, 0}};
}

// Of a training of so few primitives, and what packing it takes.
std::uint64_t most_memory(View) {
  return 256 << 20;
}

std::string read_whole(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

template <typename Settings>
Settings defaults_of(stgs_result (*defaults)(Settings*, std::size_t)) {
  Settings settings;
  require(defaults(&settings, sizeof settings) == STGS_OK, "settings have defaults");
  return settings;
}

stgs_train_settings shortest_training() {
  stgs_train_settings settings = defaults_of(stgs_train_settings_defaults);
  settings.preset = STGS_PRESET_FAST;
  settings.backend = STGS_BACKEND_CPU;
  settings.iterations = 2;
  settings.max_primitives = 300;
  return settings;
}

// What all inputs begin with: a prepared capture, a scene trained from it, and its checkpoint.
struct Origin {
  test::SyntheticCapture synthetic{3, 2};
  std::string scene, checkpoint;

  Origin() {
    const testing::TemporaryFolder folder;
    const std::string scene_path = folder / "scene.stgs", checkpoint_path = folder / "run.ckpt";
    stgs_encoder* encoder = nullptr;
    require(stgs_encoder_create(nullptr, &encoder) == STGS_OK, "an encoder is made");
    stgs_train_settings settings = shortest_training();
    settings.checkpoint = checkpoint_path.c_str();
    require(stgs_encoder_train(encoder, capture().c_str(), scene_path.c_str(), &settings,
                               nullptr) == STGS_OK,
            "a capture is trained from");
    stgs_encoder_destroy(encoder);
    scene = read_whole(scene_path);
    checkpoint = read_whole(checkpoint_path);
  }
  const std::string& capture() const { return synthetic.folder.path; }
};

const Origin& origin() {
  static const Origin made;
  return made;
}

// The settings themselves, or as another program has them.
template <typename T>
class Given {
 public:
  Given(const T& value, Choices& choices) : value_(value), other_(value, choices.next()) {
    which_ = choices.next() % 8;
  }
  const T* get() { return which_ == 1 ? nullptr : which_ == 2 ? other_.get() : &value_; }

 private:
  T value_;
  OtherSize<T> other_;
  unsigned which_;
};

// Of which an error writes nothing.
template <typename T>
class Report {
 public:
  explicit Report(std::uint8_t size) {
    T untouched;
    std::memset(static_cast<void*>(&untouched), 0xA5, sizeof untouched);
    untouched.struct_size = sizeof untouched;
    value_ = before_ = untouched;
    none_ = size % 4 == 1;
    if (size % 4 == 2) value_.struct_size = before_.struct_size = size;
  }
  T* get() { return none_ ? nullptr : &value_; }
  const T& value() const { return value_; }
  bool is_whole() const { return !none_ && value_.struct_size == sizeof value_; }
  bool is_untouched() const { return std::memcmp(&value_, &before_, sizeof value_) == 0; }

 private:
  T value_, before_;
  bool none_;
};

class Calls {
 public:
  explicit Calls(View input) : choices_(input) {
    write("scene.stgs", origin().scene);
    write("run.ckpt", origin().checkpoint);
    write("notes.txt", "no scene");
    fs::create_directory(folder_ / "empty");
    for (int k = 0; k < 12 && choices_.any_left(); ++k) call();
    stgs_encoder_destroy(encoder_);
  }

 private:
  void call() {
    switch (choices_.next() % 9) {
      case 0:
        return make();
      case 1:
        if (choices_.next() % 4 != 0) return;
        stgs_encoder_destroy(encoder_);
        encoder_ = nullptr;
        return;
      case 2:
        cancels_beside_ = true;
        return;
      case 3:
        calls_to_stop_ = 1 + choices_.next() % 8;
        return;
      case 4:
        return check_training();
      case 5:
        return train();
      case 6:
        return pack();
      case 7:
        return prepare();
      default:
        return damage();
    }
  }

  void write(const std::string& name, const std::string& bytes) const {
    std::ofstream(folder_ / name, std::ios::binary)
        .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  }

  std::map<std::string, std::string> files() const {
    std::map<std::string, std::string> out;
    for (const auto& entry : fs::recursive_directory_iterator(folder_.path)) {
      out[fs::relative(entry.path(), folder_.path)] =
          entry.is_regular_file() ? read_whole(entry.path()) : "folder";
    }
    return out;
  }

  // Kept as long as the input runs.
  const char* place(std::initializer_list<const char*> names) {
    const char* const name = *(names.begin() + choices_.next() % names.size());
    if (name == nullptr) return nullptr;
    if (*name == '\0') return "";
    return texts_.insert(name[0] == '=' ? name + 1 : folder_ / name).first->c_str();
  }

  void make() {
    stgs_encoder_settings settings = defaults_of(stgs_encoder_settings_defaults);
    constexpr std::uint32_t kThreads[] = {0, 1, 2, 3, 1024, 1025, UINT32_MAX};
    settings.threads = choices_.of(kThreads);
    const std::uint8_t hooks = choices_.next();
    if ((hooks & 1) != 0) settings.log = check_log_line;
    settings.progress_user = this;
    settings.progress = [](void* user, const stgs_encoder_progress* progress) -> std::int32_t {
      return static_cast<Calls*>(user)->on_progress(*progress) ? 1 : 0;
    };
    stgs_encoder_destroy(encoder_);
    stgs_result result = STGS_OK;
    if ((hooks & 0xE) == 0xE) {
      OtherSize<stgs_encoder_settings> other(settings, hooks >> 4);
      result = stgs_encoder_create(other.get(), &encoder_);
    } else {
      result = stgs_encoder_create(&settings, &encoder_);
    }
    require((result == STGS_OK) == (encoder_ != nullptr), "an encoder is made, or told why not");
    calls_to_stop_ = 0;
  }

  // Whether to stop.
  bool on_progress(const stgs_encoder_progress& progress) {
    require(is_called_, "progress is told during a call");
    require(!has_stopped_, "who has stopped a call is not asked again");
    require(progress.struct_size == sizeof progress && progress.stage != nullptr &&
                progress.stage[0] != '\0' && progress.detail != nullptr,
            "progress has its words");
    if (stage_ != progress.stage) done_ = 0;
    stage_ = progress.stage;
    require(progress.done >= done_ && progress.done <= 1, "a stage goes on");
    done_ = progress.done;
    has_stopped_ = calls_to_stop_ > 0 && --calls_to_stop_ == 0;
    return has_stopped_;
  }

  // What every call with an encoder has in common: `outputs` may be there afterwards where it
  // succeeds, `others` always.
  template <typename Work>
  stgs_result run(const std::set<std::string>& outputs, const std::set<std::string>& others,
                  Work&& work) {
    const auto before = files();
    is_called_ = true;
    has_stopped_ = false;
    stage_.clear();
    std::thread beside;
    if (cancels_beside_) beside = std::thread(stgs_encoder_cancel, encoder_);
    const stgs_result result = work();
    if (beside.joinable()) beside.join();
    cancels_beside_ = is_called_ = false;
    require(std::string(stgs_result_name(result)) != "unknown result", "a result has a name");
    stgs_error error{};
    error.struct_size = sizeof error;
    if (stgs_encoder_error(encoder_, &error) == STGS_OK) {
      require(error.result == result, "an error is the last call's");
      require((result == STGS_OK) == (error.message[0] == '\0'), "an error has a message");
    }
    check_files(before, result == STGS_OK ? outputs : std::set<std::string>(), others);
    return result;
  }
  void check_files(const std::map<std::string, std::string>& before,
                   const std::set<std::string>& outputs,
                   const std::set<std::string>& others) const {
    const auto may_change = [&](const std::string& name) {
      return outputs.count(folder_ / name) != 0 || others.count(folder_ / name) != 0;
    };
    const auto after = files();
    for (const auto& [name, bytes] : after) {
      if (may_change(name)) continue;
      const auto old = before.find(name);
      require(old != before.end() && old->second == bytes, "only what was asked for is written");
    }
    for (const auto& one : before) {
      require(after.count(one.first) != 0, "nothing is removed");
    }
  }

  template <typename T>
  static void check_report(const Report<T>& report, stgs_result result) {
    if (result != STGS_OK) require(report.is_untouched(), "an error reports nothing");
  }
  static void check_scene(const char* path, const std::uint64_t* bytes) {
    stgs_scene* scene = nullptr;
    require(stgs_scene_create(nullptr, &scene) == STGS_OK, "a scene is made");
    require(stgs_scene_open(scene, path) == STGS_OK, "what was written can be opened");
    stgs_scene_info info{};
    info.struct_size = sizeof info;
    require(stgs_scene_get_info(scene, &info) == STGS_OK, "what was written is told of");
    require(bytes == nullptr || *bytes == info.file_bytes, "a report has the size of the file");
    stgs_scene_destroy(scene);
  }

  stgs_train_settings training() {
    static const auto names = encoder::hyper_parameters("fast");
    stgs_train_settings s = shortest_training();
    for (int changes = choices_.next() % 4; changes > 0; --changes) {
      switch (choices_.next() % 16) {
        case 0:
          s.preset = choices_.small();
          break;
        case 1:
          s.backend = choices_.small();
          break;
        case 2: {
          constexpr std::uint32_t kIterations[] = {1, 2, 3, 100'000'001, UINT32_MAX};
          s.iterations = choices_.of(kIterations);
          break;
        }
        case 3:
          s.max_primitives = choices_.count();
          break;
        case 4:
          s.max_seconds = choices_.number();
          if (s.max_seconds >= 1) s.max_seconds = -s.max_seconds;  // takes as long
          break;
        case 5:
          s.seed = choices_.next() * std::uint64_t{0x0101010101010101};
          break;
        case 6:
          s.first_frame = choices_.small();
          break;
        case 7:
          s.end_frame = choices_.small();
          break;
        case 8:
          s.checkpoint =
              place({nullptr, "", "run.ckpt", "new.ckpt", "out.stgs", "none/x", "empty"});
          break;
        case 9:
          s.checkpoint_interval = choices_.count();
          break;
        case 10:
          s.resume = place({nullptr, "", "run.ckpt", "new.ckpt", "scene.stgs", "none", "empty"});
          break;
        case 11:
          s.log_path = place({nullptr, "", "run.jsonl", "run.ckpt", "out.stgs", "none/x", "empty"});
          break;
        case 12:
          s.held_out_evaluations = choices_.count();
          break;
        case 13:
          s.frame_memory = choices_.count() * std::uint64_t{choices_.next()};
          break;
        case 14:
          s.perceptual_weights = place({nullptr, "", "notes.txt", "none", "empty"});
          break;
        default:
          s.parameter_count = 1 + choices_.next() % 2;
          for (stgs_parameter& parameter : parameters_) {
            const std::uint8_t which = choices_.next();
            constexpr const char* kValues[] = {"0",   "1",   "2",    "0.5", "-1",    "1e-9", "1e9",
                                               "nan", "inf", "fast", "",    "1e999", nullptr};
            parameter.name = which < 2 ? nullptr : names[which % names.size()].first.c_str();
            parameter.value = choices_.of(kValues);
            // Refused with its count, or a run of so many.
            if (which >= 2 && names[which % names.size()].first == "iterations") {
              parameter.name = "no_such_rate";
            }
          }
          s.parameters = choices_.next() % 16 == 1 ? nullptr : parameters_;
          break;
      }
    }
    return s;
  }

  void check_training() {
    Given<stgs_train_settings> settings(training(), choices_);
    run({}, {}, [&] { return stgs_encoder_check_training(encoder_, settings.get()); });
  }

  void train() {
    const stgs_train_settings wanted = training();
    const char* const scene =
        place({"out.stgs", "scene.stgs", nullptr, "", "none/x.stgs", "empty", "run.ckpt"});
    constexpr const char* kNone = "none";
    const char* const capture =
        choices_.next() % 8 == 1 ? place({nullptr, "", kNone, "notes.txt", "empty", "scene.stgs"})
                                 : origin().capture().c_str();
    Given<stgs_train_settings> settings(wanted, choices_);
    // Whose defaults are a long training.
    const stgs_train_settings* const given =
        settings.get() == nullptr || settings.get()->struct_size < sizeof wanted ? &wanted
                                                                                 : settings.get();
    Report<stgs_train_report> report(choices_.next());
    std::set<std::string> others;
    for (const char* path : {wanted.checkpoint, wanted.log_path}) {
      if (path != nullptr) others.insert(path);
    }
    const stgs_result result = run({scene == nullptr ? "" : scene}, others, [&] {
      return stgs_encoder_train(encoder_, capture, scene, given, report.get());
    });
    check_report(report, result);
    if (result == STGS_OK) check_scene(scene, report.is_whole() ? &report.value().bytes : nullptr);
  }

  stgs_pack_settings packing() {
    stgs_pack_settings s = defaults_of(stgs_pack_settings_defaults);
    for (int changes = choices_.next() % 4; changes > 0; --changes) {
      double stgs_pack_settings::*const numbers[] = {
          &stgs_pack_settings::quality,         &stgs_pack_settings::target_kbps,
          &stgs_pack_settings::max_error,       &stgs_pack_settings::chunk_seconds,
          &stgs_pack_settings::metres_per_unit, &stgs_pack_settings::audio_begin};
      switch (choices_.next() % 8) {
        case 0:
          s.profile = choices_.small();
          break;
        case 1:
          s.tiers = choices_.small();
          break;
        case 2:
          s.up[choices_.next() % 3] = static_cast<float>(choices_.number());
          break;
        case 3:
          s.floor[choices_.next() % 3] = static_cast<float>(choices_.number());
          s.has_floor = choices_.small();
          break;
        case 4: {
          static const std::string kLong = "=" + std::string(100'000, 'x');
          s.audio =
              place({nullptr, "", "=music.opus", "=a b", "=\xFF\xC0", "=http://[", kLong.c_str()});
          break;
        }
        case 5:
          s.against = choices_.next() % 2 == 0 ? origin().capture().c_str()
                                               : place({"", "none", "empty", "notes.txt"});
          break;
        default:
          s.*numbers[choices_.next() % std::size(numbers)] = choices_.number();
          break;
      }
    }
    return s;
  }

  void pack() {
    Given<stgs_pack_settings> settings(packing(), choices_);
    const std::uint32_t count = choices_.next() % 4;
    const char* scenes[3];
    for (const char*& scene : scenes) {
      scene =
          place({"scene.stgs", "out.stgs", nullptr, "", "notes.txt", "none", "empty", "run.ckpt"});
    }
    const char* const output = place({"out.stgs", "packed.stgs", "scene.stgs", nullptr, "",
                                      "none/x.stgs", "empty", "notes.txt"});
    Report<stgs_pack_report> report(choices_.next());
    const stgs_result result = run({output == nullptr ? "" : output}, {}, [&] {
      return stgs_encoder_pack(encoder_, count == 3 ? nullptr : scenes, count, output,
                               settings.get(), report.get());
    });
    check_report(report, result);
    if (result == STGS_OK) {
      check_scene(output, report.is_whole() ? &report.value().bytes_out : nullptr);
    }
  }

  // What is refused, or not built: preparing itself takes pictures, and long.
  void prepare() {
    stgs_prepare_settings s = defaults_of(stgs_prepare_settings_defaults);
    const char* const names[] = {"cam00", "", nullptr};
    for (int changes = choices_.next() % 4; changes > 0; --changes) {
      std::uint32_t stgs_prepare_settings::*const counts[] = {
          &stgs_prepare_settings::test_camera_count, &stgs_prepare_settings::max_dynamic_points,
          &stgs_prepare_settings::max_static_points};
      std::int32_t stgs_prepare_settings::*const smalls[] = {
          &stgs_prepare_settings::layout,          &stgs_prepare_settings::first_frame,
          &stgs_prepare_settings::end_frame,       &stgs_prepare_settings::default_test_cameras,
          &stgs_prepare_settings::separate_motion, &stgs_prepare_settings::overwrite};
      const std::uint8_t which = choices_.next();
      if (which % 4 == 0) s.scale = choices_.number();
      if (which % 4 == 1) s.fps = choices_.number();
      if (which % 4 == 2) s.*counts[which / 4 % 3] = choices_.count() % 4;
      if (which % 4 == 3) s.*smalls[which / 4 % 6] = choices_.small();
    }
    if (choices_.next() % 4 != 1) s.test_cameras = names;
    s.test_camera_count = std::min<std::uint32_t>(s.test_camera_count, std::size(names));
    Given<stgs_prepare_settings> settings(s, choices_);
    const char* const capture = place({"empty", nullptr, "", "notes.txt", "none"});
    const char* const prepared = place({"prepared", "empty", nullptr, "", "notes.txt", "none/x"});
    Report<stgs_prepare_report> report(choices_.next());
    const stgs_result result = run({}, {}, [&] {
      return stgs_encoder_prepare(encoder_, capture, prepared, settings.get(), report.get());
    });
    check_report(report, result);
    require(result != STGS_OK, "there is nothing to prepare from");
  }

  // A byte of a file, or its end.
  void damage() {
    const std::string name = choices_.next() % 2 == 0 ? "scene.stgs" : "run.ckpt";
    std::string bytes = read_whole(folder_ / name);
    const std::size_t at = choices_.next() + std::size_t{256} * choices_.next();
    if (bytes.empty()) return;
    if (choices_.next() % 4 == 1) {
      bytes.resize(at % bytes.size());
    } else {
      bytes[at % bytes.size()] = static_cast<char>(choices_.next());
    }
    write(name, bytes);
  }

  Choices choices_;
  const testing::TemporaryFolder folder_;
  stgs_encoder* encoder_ = nullptr;
  stgs_parameter parameters_[2] = {};
  std::set<std::string> texts_;
  bool is_called_ = false, has_stopped_ = false, cancels_beside_ = false;
  int calls_to_stop_ = 0;  // of progress; 0: it goes on to the end
  std::string stage_;
  double done_ = 0;
};

}  // namespace

const Target stgs::fuzz::kTarget{"sdk_encoder", seeds, nullptr, nullptr, nullptr, most_memory};

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  (void)origin();
  Calls({data, std::min<std::size_t>(size, 256)});
  return 0;
}
