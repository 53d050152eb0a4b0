// SPDX-License-Identifier: Apache-2.0
// The option --lpips of the verbs that compare images.
#pragma once

#include <memory>
#include <string>
#include <utility>

#include "arguments.h"
#include "stgs/encoder/lpips.h"

namespace stgs::tools {

class LpipsOption {
 public:
  void declare(Arguments& app) {
    app.add_option(
        "--lpips", path_,
        "Also measure LPIPS, by the network in this safetensors file: SqueezeNet 1.1, VGG16 "
        "or AlexNet with LPIPS's channel weights");
  }
  // Reads the network if the option is given.
  Status open() {
    if (path_.empty()) return {};
    STGS_ASSIGN(auto source, open_file(path_));
    STGS_ASSIGN(network_, encoder::Lpips::read(std::move(source)));
    return {};
  }
  // The network; null without the option.
  const encoder::Lpips* network() const { return network_.get(); }
  // Adds a value to a report, with the name of the network, if there is one.
  void add(double value, Json& report) const {
    if (network_ == nullptr) return;
    report["lpips"] = value;
    report["lpips_network"] = network_->network();
  }
  std::string text(double value) const {
    return network_ == nullptr ? ""
                               : fmt::format(", lpips ({}) {:.5f}", network_->network(), value);
  }

 private:
  std::string path_;
  std::shared_ptr<const encoder::Lpips> network_;
};

}  // namespace stgs::tools
