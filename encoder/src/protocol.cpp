// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/protocol.h"

#include <algorithm>
#include <vector>

#include "natural_order.h"

namespace stgs::encoder {

const Protocol* find_protocol(std::string_view name) {
  const auto found = std::find_if(kProtocols.begin(), kProtocols.end(),
                                  [name](const Protocol& p) { return p.name == name; });
  return found == kProtocols.end() ? nullptr : &*found;
}

Status apply_protocol(const Protocol& protocol, double scale, PrepareSettings& settings) {
  if (scale != 0 && scale != protocol.scale && scale != protocol.other_scale) {
    return usage_error(
        "--scale {}: the images of protocol {} have the scale {}{}; remove --scale", scale,
        protocol.name, protocol.scale,
        protocol.other_scale == 0 ? "" : fmt::format(", or {}", protocol.other_scale));
  }
  settings.layout = protocol.layout;
  settings.first_frame = 0;
  settings.end_frame = protocol.frames;
  settings.scale = scale == 0 ? protocol.scale : scale;
  settings.test_cameras.clear();
  settings.default_test_cameras = true;
  settings.protocol = protocol.name;
  return {};
}

namespace {

// Returns whether exactly the camera of the protocol is held out.
bool has_test_camera(const Protocol& protocol, const PreparedCapture& capture) {
  std::vector<const Camera*> cameras;
  for (const Camera& camera : capture.cameras) cameras.push_back(&camera);
  std::sort(cameras.begin(), cameras.end(),
            [](const Camera* a, const Camera* b) { return natural_less(a->name, b->name); });
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    if (cameras[i]->test != (i == protocol.test_camera)) return false;
  }
  return cameras.size() > protocol.test_camera;
}

}  // namespace

Status check_protocol(const Protocol& protocol, const PreparedCapture& capture) {
  const std::string_view layout = kLayoutNames[static_cast<std::size_t>(protocol.layout)];
  if (capture.protocol == protocol.name && capture.frames == protocol.frames &&
      capture.first_frame == 0 && capture.frame_offset() == 0) {
    if (capture.source == layout && has_test_camera(protocol, capture)) return {};
    return invalid_file(
        "{}: was changed after it was prepared by protocol {}: its layout or its test camera is "
        "another one; prepare it again",
        capture.folder, protocol.name);
  }
  return usage_error(
      "{}: was not prepared by protocol {} ({}); prepare it with 'stgs prepare CAPTURE -o FOLDER "
      "--protocol {}'",
      capture.folder, protocol.name,
      capture.protocol != protocol.name
          ? (capture.protocol.empty() ? std::string("but without one")
                                      : "but by " + capture.protocol)
          : fmt::format("{} of {} frames", capture.frames, protocol.frames),
      protocol.name);
}

}  // namespace stgs::encoder
