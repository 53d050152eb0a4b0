// SPDX-License-Identifier: Apache-2.0
// stgs.hpp is self-contained, can be included twice, and compiles as C++17.
#include "stgs/stgs.hpp"

#include "stgs/stgs.hpp"

std::vector<std::uint8_t> first_frame(const std::string& location);
std::vector<std::uint8_t> first_frame(const std::string& location) {
  stgs::Scene scene;
  scene.open(location);
  return stgs::Renderer(STGS_BACKEND_CPU)
      .render_rgba8(scene, 0, scene.start_view().value_or(scene.framed(stgs::default_view())));
}
