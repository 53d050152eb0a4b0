// SPDX-License-Identifier: Apache-2.0
#include "rig_file.h"

#include <nlohmann/json.hpp>

#include "json_error.h"
#include "stgs/format/output_file.h"

namespace stgs::encoder {
namespace {

using OrderedJson = nlohmann::ordered_json;

OrderedJson json_of(const SourceCamera& camera, const FrameInfo& frames, bool states_test) {
  const bool is_stated = camera.width > 0;  // the size that the intrinsics are for
  const double* r = camera.rotation;
  const double* t = camera.translation;
  OrderedJson json = {
      {"name", camera.name},
      {"width", is_stated ? camera.width : frames.width},
      {"height", is_stated ? camera.height : frames.height},
      {"K", {{camera.fx, 0, camera.cx}, {0, camera.fy, camera.cy}, {0, 0, 1}}},
      {"w2c", {{r[0], r[1], r[2], t[0]}, {r[3], r[4], r[5], t[1]}, {r[6], r[7], r[8], t[2]}}}};
  if (camera.lens != LensModel::kPinhole) json["dist"] = camera.distortion;
  if (camera.lens == LensModel::kFisheye) json["fisheye"] = true;
  if (states_test) json["test"] = camera.test;
  return json;
}

}  // namespace

Status write_rig(const SourceCapture& capture, const std::vector<CameraPlan>& plans, double fps,
                 const std::string& path) {
  OrderedJson json = {{"fps", fps},
                      {"metric", capture.metric},
                      {"pixel_centre", 0.5},
                      {"cameras", OrderedJson::array()}};
  for (std::size_t i = 0; i < plans.size(); ++i)
    json["cameras"].push_back(json_of(capture.cameras[i], plans[i].source, capture.split_known));
  std::string text;
  try {
    text = json.dump(1) + "\n";
  } catch (const OrderedJson::exception& error) {
    return invalid_file("{}: a name is not valid UTF-8: {}", path, json_error(error));
  }
  return write_file_atomically(path,
                               {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
}

}  // namespace stgs::encoder
