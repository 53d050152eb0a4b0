// SPDX-License-Identifier: Apache-2.0
// stgs.hpp needs nothing before it, may be there twice, and is C++17.
#include "stgs/stgs.hpp"

#include "stgs/stgs.hpp"

std::vector<std::uint8_t> first_picture(const std::string& place);
std::vector<std::uint8_t> first_picture(const std::string& place) {
  stgs::Scene scene;
  scene.open(place);
  return stgs::Renderer(STGS_BACKEND_CPU)
      .render_rgba8(scene, 0, scene.start_view().value_or(scene.framed(stgs::default_view())));
}
