// SPDX-License-Identifier: Apache-2.0
// stgs_encoder.hpp is self-contained, can be included twice, and compiles as C++17.
#include "stgs/stgs_encoder.hpp"

#include "stgs/stgs_encoder.hpp"

std::uint64_t encoded_bytes(const std::string& capture, const std::string& output);
std::uint64_t encoded_bytes(const std::string& capture, const std::string& output) {
  stgs::Encoder encoder([](const stgs_encoder_progress& progress) { return progress.loss < 10; });
  encoder.check_training();
  encoder.prepare(capture, output + ".prepared");
  encoder.train(output + ".prepared", output + ".trained");
  return encoder.pack({output + ".trained"}, output).bytes_out;
}
