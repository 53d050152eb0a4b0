// SPDX-License-Identifier: Apache-2.0
/// @file
/// C++17 wrapper of stgs_encoder.h: encoders, live sessions and recorders that release
/// themselves, errors as exceptions. Header-only. The rules of the C headers on threads, ownership
/// and ranges apply.
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

/// @addtogroup api_cpp
/// @{

/// Throws Error with the encoder's message unless the result of a call on it is STGS_OK.
inline void check(stgs_result result, const stgs_encoder* encoder) {
  if (result == STGS_OK) return;
  auto error = detail::sized<stgs_error>();
  if (stgs_encoder_error(encoder, &error) != STGS_OK) throw Error(result, {});
  throw Error(result, error.message, error.offset, error.issue);
}

/// Returns the default settings of an encoder.
inline stgs_encoder_settings encoder_settings() {
  return detail::with_defaults<stgs_encoder_settings>(stgs_encoder_settings_defaults);
}
/// Returns the default settings of Encoder::prepare.
inline stgs_prepare_settings prepare_settings() {
  return detail::with_defaults<stgs_prepare_settings>(stgs_prepare_settings_defaults);
}
/// Returns the default settings of Encoder::train.
inline stgs_train_settings train_settings() {
  return detail::with_defaults<stgs_train_settings>(stgs_train_settings_defaults);
}
/// Returns the default settings of Encoder::pack.
inline stgs_pack_settings pack_settings() {
  return detail::with_defaults<stgs_pack_settings>(stgs_pack_settings_defaults);
}

/// Makes scenes: prepare, train, pack.
class Encoder {
 public:
  /// Receives progress like stgs_encoder_progress_fn, but returns true to continue. Must not throw.
  using Progress = std::function<bool(const stgs_encoder_progress&)>;

  /// Creates an encoder. `progress` replaces the callback of the settings if it is not empty.
  explicit Encoder(Progress progress = {}, stgs_encoder_settings settings = encoder_settings())
      : progress_(std::make_unique<Progress>(std::move(progress))) {
    if (*progress_) {
      settings.progress = [](void* user, const stgs_encoder_progress* current) -> std::int32_t {
        return (*static_cast<const Progress*>(user))(*current) ? 0 : 1;
      };
      settings.progress_user = progress_.get();
    }
    stgs_encoder* encoder = nullptr;
    check(stgs_encoder_create(&settings, &encoder));
    encoder_.reset(encoder);
  }

  /// Converts a capture folder into a prepared capture.
  stgs_prepare_report prepare(const std::string& capture, const std::string& prepared,
                              const stgs_prepare_settings& settings = prepare_settings()) {
    auto report = detail::sized<stgs_prepare_report>();
    check(stgs_encoder_prepare(get(), capture.c_str(), prepared.c_str(), &settings, &report),
          get());
    return report;
  }
  /// Trains a scene from a prepared capture and writes it, lossless.
  stgs_train_report train(const std::string& prepared, const std::string& scene,
                          const stgs_train_settings& settings = train_settings()) {
    auto report = detail::sized<stgs_train_report>();
    check(stgs_encoder_train(get(), prepared.c_str(), scene.c_str(), &settings, &report), get());
    return report;
  }
  /// Checks training settings without a capture.
  void check_training(const stgs_train_settings& settings = train_settings()) {
    check(stgs_encoder_check_training(get(), &settings), get());
  }
  /// Packs a scene and measures the loss.
  stgs_pack_report pack(const std::string& scene, const std::string& output,
                        const stgs_pack_settings& settings = pack_settings()) {
    auto report = detail::sized<stgs_pack_report>();
    check(stgs_encoder_pack(get(), scene.c_str(), output.c_str(), &settings, &report), get());
    return report;
  }
  /// Cancels the running call and all later ones. May be called on any thread.
  void cancel() { stgs_encoder_cancel(get()); }

  /// Returns the C object, which this object owns.
  stgs_encoder* get() const { return encoder_.get(); }

 private:
  struct Destroy {
    void operator()(stgs_encoder* encoder) const { stgs_encoder_destroy(encoder); }
  };
  std::unique_ptr<Progress> progress_;  // on the heap: its address survives a move of the encoder
  std::unique_ptr<stgs_encoder, Destroy> encoder_;
};

/// Throws Error with the session's message unless the result of a call on it is STGS_OK.
inline void check(stgs_result result, const stgs_live* live) {
  if (result == STGS_OK) return;
  auto error = detail::sized<stgs_error>();
  if (stgs_live_error(live, &error) != STGS_OK) throw Error(result, {});
  throw Error(result, error.message, error.offset, error.issue);
}

/// Returns a camera at the world origin without name and focal lengths.
inline stgs_live_camera live_camera() {
  return detail::with_defaults<stgs_live_camera>(stgs_live_camera_defaults);
}
/// Returns the default settings of a live session, which lack a rig.
inline stgs_live_settings live_settings() {
  return detail::with_defaults<stgs_live_settings>(stgs_live_settings_defaults);
}
/// Returns an image without pixels.
inline stgs_live_image live_image() {
  return detail::with_defaults<stgs_live_image>(stgs_live_image_defaults);
}

/// Encodes a rig while it films.
class Live {
 public:
  /// Receives windows like stgs_live_window_fn. Must not throw.
  using Window = std::function<void(const stgs_live_window&)>;

  /// Creates a session without a recording.
  Live() {
    stgs_live* live = nullptr;
    check(stgs_live_create(&live));
    live_.reset(live);
  }

  /// Starts the session. `window` replaces the callback of the settings if it is not empty.
  void start(const std::string& recording, stgs_live_settings settings, Window window = {}) {
    auto called = std::make_unique<Window>(std::move(window));
    if (*called) {
      settings.window = [](void* user, const stgs_live_window* written) {
        (*static_cast<const Window*>(user))(*written);
      };
      settings.window_user = called.get();
    }
    check(stgs_live_start(get(), recording.c_str(), &settings), get());
    window_ = std::move(called);
  }
  /// Adds an image of a camera. Different threads may serve different cameras.
  void push(const std::string& camera, double seconds, const stgs_live_image& image) {
    check(stgs_live_push(get(), camera.c_str(), seconds, &image), get());
  }
  /// Ends a camera.
  void end_camera(const std::string& camera) {
    check(stgs_live_end_camera(get(), camera.c_str()), get());
  }
  /// Returns the totals so far.
  stgs_live_report report() const {
    auto report = detail::sized<stgs_live_report>();
    check(stgs_live_get_report(get(), &report), get());
    return report;
  }
  /// Encodes the images that wait and completes the recording.
  void finish() { check(stgs_live_finish(get(), nullptr), get()); }
  /// Does the same, and writes the scene to another file, with its index at the front.
  void finish(const std::string& output) { check(stgs_live_finish(get(), output.c_str()), get()); }
  /// Cancels the session. May be called on any thread.
  void cancel() { stgs_live_cancel(get()); }

  /// Takes the session of another object.
  Live(Live&&) = default;
  /// Takes the session of another object. Destroys the one before.
  Live& operator=(Live&& other) noexcept {
    live_ = std::move(other.live_);  // first: it ends the session, which calls the window
    window_ = std::move(other.window_);
    return *this;
  }

  /// Returns the C object, which this object owns.
  stgs_live* get() const { return live_.get(); }

 private:
  struct Destroy {
    void operator()(stgs_live* live) const { stgs_live_destroy(live); }
  };
  std::unique_ptr<Window> window_;  // on the heap: its address survives a move of the session
  std::unique_ptr<stgs_live, Destroy> live_;  // destroyed first: it calls the window
};

/// Throws Error with the recorder's message unless the result of a call on it is STGS_OK.
inline void check(stgs_result result, const stgs_recorder* recorder) {
  if (result == STGS_OK) return;
  auto error = detail::sized<stgs_error>();
  if (stgs_recorder_error(recorder, &error) != STGS_OK) throw Error(result, {});
  throw Error(result, error.message, error.offset, error.issue);
}

/// Returns the default settings of a recording.
inline stgs_record_settings record_settings() {
  return detail::with_defaults<stgs_record_settings>(stgs_record_settings_defaults);
}
/// Returns a fragment of one frame without primitives.
inline stgs_fragment empty_fragment() {
  return detail::with_defaults<stgs_fragment>(stgs_fragment_defaults);
}

/// Records a scene live.
class Recorder {
 public:
  /// Creates a recorder without a file.
  Recorder() {
    stgs_recorder* recorder = nullptr;
    check(stgs_recorder_create(&recorder));
    recorder_.reset(recorder);
  }

  /// Creates the file of a new recording.
  void begin(const std::string& path, const stgs_record_settings& settings = record_settings()) {
    check(stgs_recorder_begin(get(), path.c_str(), &settings), get());
  }
  /// Continues a recording that was not closed.
  void resume(const std::string& path, const stgs_record_settings& settings = record_settings()) {
    check(stgs_recorder_resume(get(), path.c_str(), &settings), get());
  }
  /// Encodes a fragment and appends it.
  void append(const stgs_fragment& fragment) {
    check(stgs_recorder_append(get(), &fragment), get());
  }
  /// Marks the recording as finished.
  void close() { check(stgs_recorder_close(get()), get()); }
  /// Returns the status of the recording.
  stgs_recorder_status status() const {
    auto status = detail::sized<stgs_recorder_status>();
    check(stgs_recorder_get_status(get(), &status), get());
    return status;
  }

  /// Returns the C object, which this object owns.
  stgs_recorder* get() const { return recorder_.get(); }

 private:
  struct Destroy {
    void operator()(stgs_recorder* recorder) const { stgs_recorder_destroy(recorder); }
  };
  std::unique_ptr<stgs_recorder, Destroy> recorder_;
};

/// @}

}  // namespace hpp
}  // namespace stgs

#endif
