// SPDX-License-Identifier: Apache-2.0
// stgs_encoder.h for C++17 and later: encoders and recorders that end by themselves, errors as
// exceptions. Header only; what the C header says of threads, ownership and ranges holds here.
#ifndef STGS_STGS_ENCODER_HPP
#define STGS_STGS_ENCODER_HPP

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "stgs/stgs.hpp"
#include "stgs/stgs_encoder.h"

namespace stgs {
inline namespace hpp {

// Throws what a call on an encoder ended with, with its words.
inline void check(stgs_result result, const stgs_encoder* encoder) {
  if (result == STGS_OK) return;
  auto error = detail::sized<stgs_error>();
  if (stgs_encoder_error(encoder, &error) != STGS_OK) throw Error(result, {});
  throw Error(result, error.message, error.offset, error.issue);
}

inline stgs_encoder_settings encoder_settings() {
  return detail::with_defaults<stgs_encoder_settings>(stgs_encoder_settings_defaults);
}
inline stgs_prepare_settings prepare_settings() {
  return detail::with_defaults<stgs_prepare_settings>(stgs_prepare_settings_defaults);
}
inline stgs_train_settings train_settings() {
  return detail::with_defaults<stgs_train_settings>(stgs_train_settings_defaults);
}
inline stgs_pack_settings pack_settings() {
  return detail::with_defaults<stgs_pack_settings>(stgs_pack_settings_defaults);
}

class Encoder {
 public:
  // Called as stgs_encoder_progress_fn; true: go on. Must not throw.
  using Progress = std::function<bool(const stgs_encoder_progress&)>;

  explicit Encoder(Progress progress = {}, stgs_encoder_settings settings = encoder_settings())
      : progress_(std::make_unique<Progress>(std::move(progress))) {
    if (*progress_) {
      settings.progress = [](void* user, const stgs_encoder_progress* told) -> std::int32_t {
        return (*static_cast<const Progress*>(user))(*told) ? 0 : 1;
      };
      settings.progress_user = progress_.get();
    }
    stgs_encoder* made = nullptr;
    check(stgs_encoder_create(&settings, &made));
    encoder_.reset(made);
  }

  stgs_prepare_report prepare(const std::string& capture, const std::string& prepared,
                              const stgs_prepare_settings& settings = prepare_settings()) {
    auto report = detail::sized<stgs_prepare_report>();
    check(stgs_encoder_prepare(get(), capture.c_str(), prepared.c_str(), &settings, &report),
          get());
    return report;
  }
  stgs_train_report train(const std::string& prepared, const std::string& scene,
                          const stgs_train_settings& settings = train_settings()) {
    auto report = detail::sized<stgs_train_report>();
    check(stgs_encoder_train(get(), prepared.c_str(), scene.c_str(), &settings, &report), get());
    return report;
  }
  void check_training(const stgs_train_settings& settings = train_settings()) {
    check(stgs_encoder_check_training(get(), &settings), get());
  }
  stgs_pack_report pack(const std::vector<std::string>& scenes, const std::string& output,
                        const stgs_pack_settings& settings = pack_settings()) {
    std::vector<const char*> paths;
    for (const std::string& scene : scenes) paths.push_back(scene.c_str());
    auto report = detail::sized<stgs_pack_report>();
    check(stgs_encoder_pack(get(), paths.data(), static_cast<std::uint32_t>(paths.size()),
                            output.c_str(), &settings, &report),
          get());
    return report;
  }
  // Any thread.
  void cancel() { stgs_encoder_cancel(get()); }

  stgs_encoder* get() const { return encoder_.get(); }

 private:
  struct Destroy {
    void operator()(stgs_encoder* encoder) const { stgs_encoder_destroy(encoder); }
  };
  std::unique_ptr<Progress> progress_;  // where the library finds it, wherever this moves
  std::unique_ptr<stgs_encoder, Destroy> encoder_;
};

inline void check(stgs_result result, const stgs_recorder* recorder) {
  if (result == STGS_OK) return;
  auto error = detail::sized<stgs_error>();
  if (stgs_recorder_error(recorder, &error) != STGS_OK) throw Error(result, {});
  throw Error(result, error.message, error.offset, error.issue);
}

inline stgs_record_settings record_settings() {
  return detail::with_defaults<stgs_record_settings>(stgs_record_settings_defaults);
}
inline stgs_fragment empty_fragment() {
  return detail::with_defaults<stgs_fragment>(stgs_fragment_defaults);
}

class Recorder {
 public:
  Recorder() {
    stgs_recorder* made = nullptr;
    check(stgs_recorder_create(&made));
    recorder_.reset(made);
  }

  void begin(const std::string& path, const stgs_record_settings& settings = record_settings()) {
    check(stgs_recorder_begin(get(), path.c_str(), &settings), get());
  }
  void resume(const std::string& path, const stgs_record_settings& settings = record_settings()) {
    check(stgs_recorder_resume(get(), path.c_str(), &settings), get());
  }
  void append(const stgs_fragment& stretch) { check(stgs_recorder_append(get(), &stretch), get()); }
  void close() { check(stgs_recorder_close(get()), get()); }
  stgs_recorder_status status() const {
    auto status = detail::sized<stgs_recorder_status>();
    check(stgs_recorder_get_status(get(), &status), get());
    return status;
  }

  stgs_recorder* get() const { return recorder_.get(); }

 private:
  struct Destroy {
    void operator()(stgs_recorder* recorder) const { stgs_recorder_destroy(recorder); }
  };
  std::unique_ptr<stgs_recorder, Destroy> recorder_;
};

}  // namespace hpp
}  // namespace stgs

#endif
