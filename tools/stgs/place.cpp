// SPDX-License-Identifier: Apache-2.0
#include "place.h"

#include "losses.h"
#include "stgs/player/source.h"

namespace stgs::tools {

Result<std::unique_ptr<ByteSource>> open_place(Session& session, const std::string& place) {
  player::HttpSettings settings;
  if (player::is_url(place)) settings.stop = session.stop_token();
  settings.on_event = [&session](const player::TransferEvent& event) {
    if (event.kind != player::TransferEvent::Kind::kRetry) return;  // the verb's error tells it
    session.log(1, fmt::format("at byte {}: {}; trying again in {:.1f} s", event.offset,
                               event.message, event.wait_seconds));
  };
  return player::open_location(place, settings);
}

Result<std::unique_ptr<SceneReader>> open_scene(Session& session, const std::string& place) {
  STGS_ASSIGN(std::unique_ptr<ByteSource> source, open_place(session, place));
  return SceneReader::open(std::move(source));
}

Status check_is_path(const std::string& place) {
  if (!player::is_url(place)) return {};
  return usage_error("{}: is a URL, of which this verb reads none; fetch the file first",
                     player::display_location(place));
}

Result<Scene> read_place(Session& session, const std::string& place) {
  STGS_ASSIGN(std::unique_ptr<ByteSource> source, open_place(session, place));
  DamageReport losses;
  STGS_ASSIGN(Scene scene, recover_scene(std::move(source), losses));
  tell_losses(session, player::display_location(place), losses, scene.metadata.time_base);
  return scene;
}

}  // namespace stgs::tools
