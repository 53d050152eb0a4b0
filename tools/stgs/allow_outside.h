// SPDX-License-Identifier: Apache-2.0
// --allow-outside of the verbs that read a capture.
#pragma once

#include "arguments.h"

namespace stgs::tools {

inline Argument* add_allow_outside(Arguments& app, bool& value) {
  return app.add_flag("--allow-outside", value,
                      "Trust the capture: its paths and links may leave its folder");
}

}  // namespace stgs::tools
