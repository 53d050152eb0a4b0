// SPDX-License-Identifier: Apache-2.0
#include "scene_input.h"

#include "damage.h"
#include "stgs/player/source.h"

namespace stgs::tools {

Result<std::unique_ptr<ByteSource>> open_source(Session& session, const std::string& location) {
  player::HttpSettings settings;
  if (player::is_url(location)) settings.stop = session.stop_token();
  settings.on_event = [&session](const player::TransferEvent& event) {
    // Other events end the transfer: the verb reports them as its error.
    if (event.kind != player::TransferEvent::Kind::kRetry) return;
    session.log(1, fmt::format("at byte {}: {}; retrying in {:.1f} s", event.offset, event.message,
                               event.wait_seconds));
  };
  return player::open_location(location, settings);
}

Result<std::unique_ptr<SceneReader>> open_scene(Session& session, const std::string& location) {
  STGS_ASSIGN(std::unique_ptr<ByteSource> source, open_source(session, location));
  return SceneReader::open(std::move(source));
}

Result<Scene> load_scene(Session& session, const std::string& location) {
  STGS_ASSIGN(std::unique_ptr<ByteSource> source, open_source(session, location));
  DamageReport damage;
  STGS_ASSIGN(Scene scene, recover_scene(std::move(source), damage));
  warn_of_damage(session, player::display_location(location), damage, scene.metadata.time_base);
  return scene;
}

Status check_is_path(const std::string& location) {
  if (!player::is_url(location)) return {};
  return usage_error("{}: this verb reads local files only; download the file first",
                     player::display_location(location));
}

}  // namespace stgs::tools
