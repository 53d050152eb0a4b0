// SPDX-License-Identifier: Apache-2.0
// The FILE argument of verbs that use the library as applications do: through stgs.h alone.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>

#include "damage_count.h"
#include "session.h"
#include "stgs/stgs.h"

namespace stgs::tools {

// Converts the outcome of a call on an object of the library, with its message.
Status status_of(stgs_result result, const stgs_error& error);

// Returns a struct that the library fills, with its size set.
template <typename T>
T sized() {
  T out{};
  out.struct_size = sizeof(T);
  return out;
}

// Converts the outcome of the last call on an object. `get_error`: such as stgs_scene_error.
template <typename Object>
Status status_of(stgs_result result, const Object* object,
                 stgs_result (*get_error)(const Object*, stgs_error*)) {
  if (result == STGS_OK) return {};
  auto error = sized<stgs_error>();
  if (get_error(object, &error) != STGS_OK) error.message = stgs_result_name(result);
  return status_of(result, error);
}

// Warns of the damage found when the file of a scene was opened. `name`: of the file.
Status warn_of_open_damage(Session& session, stgs_scene* scene, const std::string& name);
// Returns a text of an open scene, or "".
std::string text_of(stgs_scene* scene, stgs_text which);

// A scene of the library that logs to the session.
class SceneFile {
 public:
  // Of decoded data, bytes: the default of open().
  static constexpr std::uint64_t kMaxMemory = std::uint64_t{4} << 30;
  // Opens a path, a URL or "-". SIGINT and SIGTERM cancel reads from a URL. `memory` bounds the
  // decoded data, and the memory for decoding, bytes. The session must outlive the result.
  static Result<std::unique_ptr<SceneFile>> open(Session& session, const std::string& location,
                                                 std::uint64_t memory = kMaxMemory);
  // Used by open().
  explicit SceneFile(Session& session) : session_(session) {}

  stgs_scene* get() const { return scene_.get(); }
  // Returns the name for messages.
  const std::string& name() const { return name_; }
  // Converts the result of a call on the scene.
  Status check(stgs_result result) const;
  // Returns the limits of open(), bytes.
  std::uint64_t memory() const { return memory_; }
  // Returns a text of the file, or "".
  std::string text(stgs_text which) const { return text_of(get(), which); }
  // Warns of the damage found when the file was opened.
  Status warn_of_open_damage() const { return tools::warn_of_open_damage(session_, get(), name_); }
  // Counts the segments that rendering has skipped, or rendered without SH.
  Result<DamageCount> count_damage() const;
  // Whether the warnings of the library, about damage, are logged. Retries of transfers always are.
  void set_log_warnings(bool log_warnings) { log_warnings_ = log_warnings; }

 private:
  struct Destroy {
    void operator()(stgs_scene* scene) const { stgs_scene_destroy(scene); }
  };
  static void log(void* self, stgs_log_level level, const char* message);
  Status open(const std::string& location, std::uint64_t memory);

  Session& session_;
  bool log_warnings_ = false;
  std::uint64_t memory_ = kMaxMemory;
  std::string name_;
  std::unique_ptr<stgs_scene, Destroy> scene_;
  std::optional<std::stop_callback<std::function<void()>>> cancel_;  // destroyed before the scene
};

}  // namespace stgs::tools
