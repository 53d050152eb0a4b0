// SPDX-License-Identifier: Apache-2.0
#include "scene_file.h"

#include "end_after_signal.h"
#include "location.h"
#include "standard_streams.h"

namespace stgs::tools {

Status status_of(stgs_result result, const stgs_error& error) {
  const auto code = [&] {
    switch (result) {
      case STGS_OK:
        return StatusCode::kOk;
      case STGS_ERROR_ARGUMENT:
        return StatusCode::kUsage;
      case STGS_ERROR_IO:
        return StatusCode::kIo;
      case STGS_ERROR_INVALID_FILE:
        return StatusCode::kInvalidFile;
      case STGS_ERROR_OUT_OF_MEMORY:
        return StatusCode::kNoMemory;
      case STGS_ERROR_LIMIT:
        // An issue is a property of the file; without one, the program has set the limit.
        return error.issue != 0 ? StatusCode::kUnsupported : StatusCode::kLimit;
      case STGS_ERROR_DEVICE_LOST:
        return StatusCode::kDeviceLost;
      case STGS_ERROR_UNSUPPORTED:
        return StatusCode::kUnsupported;
      case STGS_ERROR_NOT_BUILT:
        return StatusCode::kNotBuilt;
      default:
        return StatusCode::kRuntime;
    }
  }();
  return code == StatusCode::kOk ? Status() : Status(code, error.message);
}

Status warn_of_open_damage(Session& session, stgs_scene* scene, const std::string& name) {
  auto info = sized<stgs_scene_info>();
  STGS_TRY(status_of(stgs_scene_get_info(scene, &info), scene, stgs_scene_error));
  for (std::uint32_t i = 0; i < info.issues; ++i) {
    auto issue = sized<stgs_issue>();
    STGS_TRY(status_of(stgs_scene_get_issue(scene, i, &issue), scene, stgs_scene_error));
    warn_of_issue(session, name, issue.message, info.complete_seconds);
  }
  return {};
}

std::string text_of(stgs_scene* scene, stgs_text which) {
  const char* text = "";
  return stgs_scene_get_text(scene, which, &text) == STGS_OK ? text : "";
}

Status SceneFile::check(stgs_result result) const {
  return status_of(result, get(), stgs_scene_error);
}

Result<DamageCount> SceneFile::count_damage() const {
  auto contents = sized<stgs_contents>();
  STGS_TRY(check(stgs_scene_get_contents(get(), &contents)));
  DamageCount count;
  for (std::uint32_t i = 0; i < contents.damaged_segments; ++i) {
    auto damaged = sized<stgs_damaged_segment>();
    STGS_TRY(check(stgs_scene_get_damaged_segment(get(), i, &damaged)));
    ++(damaged.sh_only != 0 ? count.without_sh : count.skipped);
    if (i == 0) count.first = damaged.message;
  }
  return count;
}

void SceneFile::log(void* self, stgs_log_level level, const char* message) {
  const auto& file = *static_cast<const SceneFile*>(self);
  const bool is_retry = level == STGS_LOG_INFO;
  if (is_retry || file.log_warnings_) file.session_.log(1, message);
}

Status SceneFile::open(const std::string& location, std::uint64_t memory) {
  const bool is_stdin = is_standard_input(location);
  name_ = display_name(location);
  memory_ = memory;
  stgs_scene_settings settings;
  if (stgs_scene_settings_defaults(&settings, sizeof(settings)) != STGS_OK) {
    return runtime_error("the library is older than the program");
  }
  settings.memory_budget = settings.max_memory = memory;
  settings.url_timeout_seconds = session_.options.timeout;
  settings.url_allow_private = session_.options.allow_private ? 1 : 0;
  settings.log = log;
  settings.log_user = this;
  settings.name = name_.c_str();
  stgs_scene* scene = nullptr;
  const stgs_result created = stgs_scene_create(&settings, &scene);
  if (created != STGS_OK) return runtime_error("{}: {}", name_, stgs_result_name(created));
  scene_.reset(scene);
  if (is_url(location))
    cancel_.emplace(session_.stop_token(), [scene] { stgs_scene_cancel(scene); });
  if (!is_stdin) return check(stgs_scene_open(scene, location.c_str()));
  STGS_ASSIGN(const auto bytes, read_standard_input(memory, kStandardInputAdvice));
  if (bytes.empty()) return check(stgs_scene_open_memory(scene, "", 0));
  return check(stgs_scene_open_memory(scene, bytes.data(), bytes.size()));
}

Result<std::unique_ptr<SceneFile>> SceneFile::open(Session& session, const std::string& location,
                                                   std::uint64_t memory) {
  const EndAfterSignal end(session, display_name(location) + ": not opened");
  auto file = std::make_unique<SceneFile>(session);
  STGS_TRY(file->open(location, memory));
  return file;
}

}  // namespace stgs::tools
