// SPDX-License-Identifier: Apache-2.0
// Encoders and recorders of the C API, their reports, and captures to encode.
#pragma once

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "fixtures/synthetic_capture.h"
#include "fixtures/temporary_folder.h"
#include "sdk_fixture.h"
#include "stgs/stgs_encoder.h"
#include "struct_sizes.h"

namespace stgs::testing {

namespace fs = std::filesystem;
using Bytes = std::vector<char>;

// Sorted; includes hidden files.
inline std::vector<std::string> file_names_in(const std::string& folder) {
  std::vector<std::string> out;
  for (const auto& entry : fs::directory_iterator(folder)) {
    out.push_back(entry.path().filename().string());
  }
  std::sort(out.begin(), out.end());
  return out;
}

inline Bytes bytes_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

// Primitives of SH degree 0, with a value for every array of a fragment.
struct Primitives {
  std::vector<float> position, velocity, scale, rotation, opacity, sh, time, sigma, radius,
      importance;

  explicit Primitives(std::size_t count, float x = 0) {
    for (std::size_t i = 0; i < count; ++i) {
      const auto k = static_cast<float>(i);
      position.insert(position.end(), {x + 0.5f * k, -0.25f * k, 4});
      velocity.insert(velocity.end(), {0, 0.6f, -0.3f});
      scale.insert(scale.end(), {0.1f, 0.2f, 0.4f});
      rotation.insert(rotation.end(), {2, 0.4f, 0, 1});
      opacity.push_back(0.5f);
      sh.insert(sh.end(), {1, -0.5f, 0.25f});
      time.push_back(0.2f);
      sigma.push_back(0.02f);
      radius.push_back(0.1f);
      importance.push_back(1);
    }
  }
  stgs_fragment fragment(std::uint32_t frames) const {
    stgs_fragment out;
    REQUIRE(stgs_fragment_defaults(&out, sizeof out) == STGS_OK);
    out.frames = frames;
    out.count = opacity.size();
    out.position = position.data();
    out.velocity = velocity.data();
    out.scale = scale.data();
    out.rotation = rotation.data();
    out.opacity = opacity.data();
    out.sh = sh.data();
    out.time = time.data();
    out.sigma = sigma.data();
    out.radius = radius.data();
    out.importance = importance.data();
    return out;
  }
  // Only the arrays that a fragment must have.
  stgs_fragment minimal_fragment(std::uint32_t frames) const {
    stgs_fragment out = fragment(frames);
    out.velocity = out.rotation = out.time = out.sigma = out.radius = out.importance = nullptr;
    return out;
  }
};

struct DestroyEncoder {
  void operator()(stgs_encoder* encoder) const { stgs_encoder_destroy(encoder); }
};

// An encoder whose callbacks record stages and log lines, and cancel if `should_cancel` returns
// true.
class ObservedEncoder {
 public:
  explicit ObservedEncoder(std::uint32_t threads = 0) {
    stgs_encoder_settings settings;
    REQUIRE(stgs_encoder_settings_defaults(&settings, sizeof settings) == STGS_OK);
    settings.threads = threads;
    settings.progress_user = settings.log_user = this;
    settings.progress = [](void* user, const stgs_encoder_progress* progress) -> std::int32_t {
      return static_cast<ObservedEncoder*>(user)->on_progress(*progress);
    };
    settings.log = [](void* user, stgs_log_level, const char* message) {
      static_cast<ObservedEncoder*>(user)->lines.emplace_back(message);
    };
    stgs_encoder* created = nullptr;
    REQUIRE(stgs_encoder_create(&settings, &created) == STGS_OK);
    encoder_.reset(created);
  }

  stgs_encoder* get() const { return encoder_.get(); }
  stgs_error error() const {
    stgs_error error{};
    error.struct_size = sizeof error;
    REQUIRE(stgs_encoder_error(get(), &error) == STGS_OK);
    return error;
  }
  bool has_reported(const std::string& stage) const {
    return std::find(stages.begin(), stages.end(), stage) != stages.end();
  }

  std::function<bool(const stgs_encoder_progress&)> should_cancel;
  std::vector<std::string> stages, lines;
  int calls_after_cancel = 0;
  bool is_monotonic = true;
  stgs_encoder_progress last_training{};

 private:
  std::int32_t on_progress(const stgs_encoder_progress& progress) {
    if (cancelled_) ++calls_after_cancel;
    if (stages.empty() || stages.back() != progress.stage) {
      // No stage is reported twice, so a program can show one progress bar per stage.
      is_monotonic = is_monotonic && !has_reported(progress.stage);
      stages.emplace_back(progress.stage);
      done_ = 0;
    }
    is_monotonic = is_monotonic && progress.done >= done_ && progress.done <= 1;
    done_ = progress.done;
    if (stages.back() == "train") last_training = progress;
    cancelled_ = should_cancel && should_cancel(progress);
    return cancelled_ ? 1 : 0;
  }

  std::unique_ptr<stgs_encoder, DestroyEncoder> encoder_;
  double done_ = 0;
  bool cancelled_ = false;
};

struct DestroyRecorder {
  void operator()(stgs_recorder* recorder) const { stgs_recorder_destroy(recorder); }
};
using RecorderPtr = std::unique_ptr<stgs_recorder, DestroyRecorder>;

inline RecorderPtr make_recorder() {
  stgs_recorder* recorder = nullptr;
  REQUIRE(stgs_recorder_create(&recorder) == STGS_OK);
  return RecorderPtr(recorder);
}

// A prepared capture, generated without OpenCV.
class PreparedCapture {
 public:
  std::string folder() const { return synthetic_.capture.folder; }
  std::string path(const std::string& name) const { return folder() + "/" + name; }

 private:
  test::SyntheticCapture synthetic_;
};

inline stgs_train_settings short_training(std::uint32_t iterations = 60) {
  stgs_train_settings settings;
  REQUIRE(stgs_train_settings_defaults(&settings, sizeof settings) == STGS_OK);
  settings.preset = STGS_PRESET_FAST;
  settings.backend = STGS_BACKEND_CPU;
  settings.iterations = iterations;
  settings.max_primitives = 600;
  return settings;
}
inline stgs_pack_settings pack_settings() {
  stgs_pack_settings settings;
  REQUIRE(stgs_pack_settings_defaults(&settings, sizeof settings) == STGS_OK);
  return settings;
}
// A zeroed output struct with its size set.
template <typename Output>
Output empty_output() {
  Output output{};
  output.struct_size = sizeof output;
  return output;
}

inline stgs_result pack_one(const ObservedEncoder& encoder, const std::string& scene,
                            const std::string& output, const stgs_pack_settings* settings = nullptr,
                            stgs_pack_report* report = nullptr) {
  return stgs_encoder_pack(encoder.get(), scene.c_str(), output.c_str(), settings, report);
}

}  // namespace stgs::testing
