// SPDX-License-Identifier: Apache-2.0
#include "scene_input.h"

#include <algorithm>

#include "damage.h"
#include "end_after_signal.h"
#include "standard_streams.h"
#include "stgs/player/source.h"

namespace stgs::tools {

namespace {

// Bytes that stay valid, without a copy of them.
class ViewSource final : public ByteSource {
 public:
  ViewSource(std::span<const std::uint8_t> bytes, std::string name)
      : bytes_(bytes), name_(std::move(name)) {}
  std::uint64_t size() const override { return bytes_.size(); }
  const std::string& name() const override { return name_; }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    STGS_TRY(check_range(name_, size(), offset, out.size()));
    const auto from = bytes_.subspan(static_cast<std::size_t>(offset), out.size());
    std::copy(from.begin(), from.end(), out.begin());
    return {};
  }

 private:
  std::span<const std::uint8_t> bytes_;
  std::string name_;
};

}  // namespace

Result<std::unique_ptr<ByteSource>> open_source(Session& session, const std::string& location,
                                                std::uint64_t memory) {
  if (is_standard_input(location)) {
    STGS_ASSIGN(const auto bytes, read_standard_input(memory, kStandardInputAdvice));
    return std::unique_ptr<ByteSource>(std::make_unique<ViewSource>(bytes, display_name(location)));
  }
  player::HttpSettings settings;
  settings.request_seconds = session.options.timeout;
  settings.allow_private = session.options.allow_private;
  if (player::is_url(location)) settings.stop = session.stop_token();
  settings.on_event = [&session](const player::TransferEvent& event) {
    // Other events end the transfer: the verb reports them as its error.
    if (event.kind != player::TransferEvent::Kind::kRetry) return;
    session.log(1, fmt::format("at byte {}: {}; retrying in {:.1f} s", event.offset, event.message,
                               event.wait_seconds));
  };
  return player::open_location(location, settings);
}

Result<std::unique_ptr<SceneReader>> open_scene(Session& session, const std::string& location,
                                                const ReadLimits& limits) {
  const EndAfterSignal end(session, display_name(location) + ": not opened");
  STGS_ASSIGN(std::unique_ptr<ByteSource> source,
              open_source(session, location, limits.max_memory));
  return SceneReader::open(std::move(source), limits);
}

Result<Scene> load_scene(Session& session, const std::string& location, const ReadLimits& limits) {
  const EndAfterSignal end(session, display_name(location) + ": not read");
  STGS_ASSIGN(std::unique_ptr<ByteSource> source,
              open_source(session, location, limits.max_memory));
  DamageReport damage;
  Result<Scene> scene = recover_scene(std::move(source), damage, limits);
  if (!scene.ok()) return scene;
  warn_of_damage(session, display_name(location), damage, scene->metadata.time_base);
  return scene;
}

Status check_is_scene(Session& session, const std::string& location, const ReadLimits& limits) {
  return open_scene(session, location, limits).status();
}

Status write_error(const Status& status, const std::string& input, const std::string& output) {
  if (status.code() != StatusCode::kUsage) {
    return {status.code(), fmt::format("{}: {}", output, status.message())};
  }
  return invalid_file("{}: cannot be converted: {}", display_name(input), status.message());
}

}  // namespace stgs::tools
