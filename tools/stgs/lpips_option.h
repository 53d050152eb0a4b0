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
  // Checks that the network, if there is one, can compare images of this size within `memory`
  // bytes. kUnsupported or kLimit names `name`, which has this size.
  Status check(int width, int height, std::uint64_t memory, const std::string& name) const {
    if (network_ == nullptr) return {};
    if (const Status size = network_->check_size(width, height); !size.ok())
      return unsupported("{}: {}", name, size.message());
    const std::uint64_t bytes = network_->working_bytes(width, height);
    if (bytes <= memory) return {};
    return {StatusCode::kLimit,
            fmt::format("{}: LPIPS of {}x{} pixels needs {}, more than the memory limit of {}; use "
                        "SqueezeNet, smaller images, or a larger --memory",
                        name, width, height, human_bytes(bytes), human_bytes(memory))};
  }
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
