// SPDX-License-Identifier: Apache-2.0
#include <chrono>
#include <cmath>
#include <filesystem>
#include <mutex>
#include <thread>

#include "encoder/live_settings.h"
#include "encoder/thread_errors.h"
#include "stgs/encoder/device_image.h"
#include "stgs/format/output_path.h"
#include "stgs/format/task_runner.h"
#include "stgs/format/temporary.h"

namespace stgs::sdk {
namespace {

namespace fs = std::filesystem;

constexpr auto kPoll = std::chrono::milliseconds(5);  // for a cancellation, which nobody signals

// A session that has started.
class LiveSession {
 public:
  // Settings that have been checked, except for the rig.
  static Outcome start(const std::string& recording, const stgs_live_settings& settings,
                       std::unique_ptr<LiveSession>& out) {
    std::unique_ptr<LiveSession> session(new LiveSession(recording, settings));
    STGS_SDK_TRY(session->open(settings));
    out = std::move(session);
    return {};
  }

  Outcome push(const char* camera, double seconds, const stgs_live_image& image);
  Outcome end_camera(const char* camera);
  stgs_live_report report() const { return to_c(encoder_->report(), encoder_->ended()); }
  bool is_finished() const { return finished_; }
  void stop() { encoder_->stop(); }
  // An empty output: the recording alone.
  Outcome finish(const std::string& output, const std::atomic<bool>& cancelled);

 private:
  LiveSession(const std::string& recording, const stgs_live_settings& settings)
      : recording_(recording), threads_(make_thread_pool(settings.threads)) {
    const encoder::LogSink sink = log_sink({settings.log, settings.log_user});
    log_ = [this, sink](int level, const std::string& line) {
      const std::lock_guard lock(log_mutex_);
      sink(level, line);
    };
  }

  Outcome open(const stgs_live_settings& settings);
  Outcome find(const char* name, std::size_t& out) const;
  // Returns the pixels on the host.
  Result<const std::uint8_t*> pixels_of(std::size_t camera, stgs_live_image& image);

  const std::string recording_;
  std::mutex log_mutex_;
  encoder::LogSink log_;
  std::unique_ptr<TaskRunner> threads_;  // null: the default pool
  OutputLock lock_;
  WorkFolder folder_;
  std::unique_ptr<encoder::LivePreparer> preparer_;
  std::vector<std::vector<std::uint8_t>> copies_;  // of images on a device, per camera
  std::atomic<bool> finished_{false};
  std::unique_ptr<encoder::LiveEncoder> encoder_;  // last: it uses the members above
};

Outcome LiveSession::open(const stgs_live_settings& settings) {
  STGS_SDK_TRY(open_rig(settings, log_, preparer_));
  copies_.resize(preparer_->cameras().size());
  STGS_TRY(prepare_output(recording_, lock_, log_));
  if (fs::exists(recording_))
    return io_error("{}: exists; name another file, or remove it", recording_);
  STGS_TRY(folder_.create(recording_));
  const std::string work = folder_.path() + "/live";
  fs::create_directory(work);
  encoder::LiveSettings encoding = live_encoding_of(settings, recording_);
  encoding.tasks = threads_.get();
  encoder::LiveWindowSink windows;
  if (settings.window != nullptr) {
    windows = [call = settings.window, user = settings.window_user](const auto& window) {
      const stgs_live_window out = to_c(window);
      call(user, &out);
    };
  }
  STGS_ASSIGN(encoder_,
              encoder::LiveEncoder::open(*preparer_, work, encoding, std::move(windows), log_));
  return {};
}

Outcome LiveSession::find(const char* name, std::size_t& out) const {
  if (name == nullptr) return {STGS_ERROR_ARGUMENT, "camera is NULL (expected a name)"};
  const auto& cameras = preparer_->cameras();
  const auto found = std::find_if(cameras.begin(), cameras.end(),
                                  [name](const auto& camera) { return camera.name == name; });
  if (found == cameras.end()) {
    return {STGS_ERROR_ARGUMENT,
            fmt::format("no camera '{}' takes part; the first is '{}'", name, cameras[0].name)};
  }
  out = static_cast<std::size_t>(found - cameras.begin());
  return {};
}

Result<const std::uint8_t*> LiveSession::pixels_of(std::size_t camera, stgs_live_image& image) {
  if (image.memory == STGS_MEMORY_HOST) return static_cast<const std::uint8_t*>(image.data);
  const std::size_t row = pixel_bytes(image.format) * image.width;
  std::vector<std::uint8_t>& copy = copies_[camera];
  copy.resize(row * image.height);
  STGS_TRY(encoder::copy_from_device({image.data, image.stride, row, image.height, image.stream},
                                     copy.data()));
  image.stride = row;
  return copy.data();
}

Outcome LiveSession::push(const char* camera, double seconds, const stgs_live_image& given) {
  std::size_t index = 0;
  STGS_SDK_TRY(find(camera, index));
  if (!std::isfinite(seconds)) {
    return {STGS_ERROR_ARGUMENT, fmt::format("seconds is {} (expected a finite number)", seconds)};
  }
  stgs_live_image image = given;
  STGS_SDK_TRY(check(image));
  if (encoder_->ended()) {
    return {STGS_ERROR_STATE, "encoding has ended; stgs_live_finish returns the reason"};
  }
  STGS_ASSIGN(const std::uint8_t* pixels, pixels_of(index, image));
  encoder::LiveImage from;
  from.data = pixels;
  from.width = static_cast<int>(image.width);
  from.height = static_cast<int>(image.height);
  from.stride = image.stride;
  from.bgr = image.format == STGS_PIXELS_BGR8 || image.format == STGS_PIXELS_BGRA8;
  from.has_alpha = pixel_bytes(image.format) == 4;
  Result<encoder::Image8> frame = preparer_->convert(index, from);
  if (!frame.ok()) {
    // The image does not fit the calibration.
    const Status& status = frame.status();
    if (status.code() == StatusCode::kInvalidFile) return usage_error("{}", status.message());
    return status;
  }
  encoder_->push(index, seconds, std::move(*frame));
  return {};
}

Outcome LiveSession::end_camera(const char* camera) {
  std::size_t index = 0;
  STGS_SDK_TRY(find(camera, index));
  encoder_->end_camera(index);
  return {};
}

Outcome LiveSession::finish(const std::string& output, const std::atomic<bool>& cancelled) {
  OutputLock lock;
  if (!output.empty()) {
    STGS_TRY(check_distinct({{"output", output}, {"recording", recording_}}));
    STGS_TRY(prepare_output(output, lock, log_));
  }
  finished_ = true;
  for (std::size_t c = 0; c < copies_.size(); ++c) encoder_->end_camera(c);
  while (!encoder_->ended() && !cancelled) std::this_thread::sleep_for(kPoll);
  if (cancelled) {
    encoder_->stop();
    return {STGS_ERROR_CANCELLED, "the session was cancelled"};
  }
  const ScopedTaskRunner use(threads_.get());
  return encoder_->finish(output);
}

}  // namespace
}  // namespace stgs::sdk

struct stgs_live {
  stgs::sdk::ThreadErrors error;
  std::unique_ptr<stgs::sdk::LiveSession> session;  // null: not started
  std::atomic<bool> cancelled{false};
  static_assert(std::atomic<bool>::is_always_lock_free, "signal handlers set it");

  stgs::sdk::Outcome check_started() const {
    if (session != nullptr) return {};
    return {STGS_ERROR_STATE, "the session has not started; call stgs_live_start first"};
  }
  stgs::sdk::Outcome check_not_cancelled() const {
    if (!cancelled) return {};
    return {STGS_ERROR_CANCELLED, "the session was cancelled; create another session"};
  }
  stgs::sdk::Outcome check_running() const {
    STGS_SDK_TRY(check_not_cancelled());
    STGS_SDK_TRY(check_started());
    if (!session->is_finished()) return {};
    return {STGS_ERROR_STATE, "the session is finished; create another session"};
  }
};

extern "C" {

stgs_result stgs_live_camera_defaults(stgs_live_camera* camera, size_t struct_size) {
  return stgs::sdk::fill_defaults(camera, struct_size, stgs::sdk::default_live_camera());
}

stgs_result stgs_live_settings_defaults(stgs_live_settings* settings, size_t struct_size) {
  return stgs::sdk::fill_defaults(settings, struct_size, stgs::sdk::default_live_settings());
}

stgs_result stgs_live_image_defaults(stgs_live_image* image, size_t struct_size) {
  return stgs::sdk::fill_defaults(image, struct_size, stgs::sdk::default_live_image());
}

stgs_result stgs_live_create(stgs_live** out) {
  if (out == nullptr) return STGS_ERROR_ARGUMENT;
  *out = new (std::nothrow) stgs_live;
  return *out == nullptr ? STGS_ERROR_OUT_OF_MEMORY : STGS_OK;
}

void stgs_live_destroy(stgs_live* live) {
  delete live;
}

stgs_result stgs_live_error(const stgs_live* live, stgs_error* error) {
  return live == nullptr ? STGS_ERROR_ARGUMENT : live->error.get(error);
}

stgs_result stgs_live_start(stgs_live* live, const char* recording,
                            const stgs_live_settings* settings) {
  using namespace stgs::sdk;
  return guarded(live, [&]() -> Outcome {
    STGS_SDK_TRY(live->check_not_cancelled());
    if (live->session != nullptr) {
      return {STGS_ERROR_STATE, "the session has already started; create another session"};
    }
    STGS_SDK_TRY(check_path("recording", recording));
    stgs_live_settings known = default_live_settings();
    STGS_SDK_TRY(copy_in(settings, known, "settings"));
    STGS_SDK_TRY(check(known));
    const stgs::encoder::KeptDevice kept;
    return LiveSession::start(recording, known, live->session);
  });
}

stgs_result stgs_live_push(stgs_live* live, const char* camera, double seconds,
                           const stgs_live_image* image) {
  using namespace stgs::sdk;
  return guarded(live, [&]() -> Outcome {
    STGS_SDK_TRY(live->check_running());
    stgs_live_image known = default_live_image();
    STGS_SDK_TRY(copy_in(image, known, "image"));
    return live->session->push(camera, seconds, known);
  });
}

stgs_result stgs_live_end_camera(stgs_live* live, const char* camera) {
  using namespace stgs::sdk;
  return guarded(live, [&]() -> Outcome {
    STGS_SDK_TRY(live->check_running());
    return live->session->end_camera(camera);
  });
}

stgs_result stgs_live_get_report(stgs_live* live, stgs_live_report* report) {
  using namespace stgs::sdk;
  return guarded(live, [&]() -> Outcome {
    STGS_SDK_TRY(live->check_started());
    STGS_SDK_TRY(check_struct(report, "report"));
    copy_out(report, live->session->report());
    return {};
  });
}

stgs_result stgs_live_finish(stgs_live* live, const char* output) {
  using namespace stgs::sdk;
  return guarded(live, [&]() -> Outcome {
    if (live->cancelled && live->session != nullptr) live->session->stop();
    STGS_SDK_TRY(live->check_running());
    return live->session->finish(text_of(output), live->cancelled);
  });
}

void stgs_live_cancel(stgs_live* live) {
  if (live != nullptr) live->cancelled = true;
}

}  // extern "C"
