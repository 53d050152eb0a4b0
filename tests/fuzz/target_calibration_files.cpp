// SPDX-License-Identifier: Apache-2.0
// Calibrations of other tools, each file by its own reader. The first byte of an input is the kind
// of the file.
#include "capture/calibration.h"
#include "capture_seeds.h"
#include "captures.h"

using namespace stgs;
using namespace stgs::fuzz;
using namespace stgs::encoder;

namespace {

constexpr const char* kFiles[] = {"calib.toml", "a.qca.txt", "a.yml", "a.json", "a.xml"};

std::vector<Bytes> seeds() {
  const std::string contents[] = {toml_calibration(), qualisys_calibration(), yaml_calibration(0),
                                  json_calibration(0), xml_calibration(0)};
  std::vector<Bytes> out;
  for (std::size_t kind = 0; kind < std::size(contents); ++kind) {
    Bytes& input = out.emplace_back();
    input.push_back(static_cast<std::uint8_t>(kind));
    input.insert(input.end(), contents[kind].begin(), contents[kind].end());
  }
  return out;
}

// The parsers keep a node for a few bytes of text.
std::uint64_t memory(View input) {
  return 256 * input.size() + (128 << 10);
}

Result<Calibration> read(const CaptureFolder& files, std::size_t kind) {
  const std::string path = files.path() + "/" + kFiles[kind];
  const LogSink log = [](int, const std::string& message) {
    require(!message.empty(), "a message has a text");
  };
  if (kind == 0) return read_toml_calibration(files, path);
  if (kind == 1) return read_qualisys(files, path, log);
  return read_opencv_camera(files, path, "a");
}

}  // namespace

const Target stgs::fuzz::kTarget{"calibration_files", seeds, nullptr, nullptr, nullptr, memory};

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const InputFolder& folder = input_folder();
  static const auto files = CaptureFolder::open(folder.path(), false);
  require(files.ok(), "the folder can be opened");
  if (size == 0) return 0;
  const std::size_t kind = data[0] % std::size(kFiles);
  write_input(folder.path() + "/" + kFiles[kind],
              {reinterpret_cast<const char*>(data) + 1, size - 1});
  const auto calibration = read(**files, kind);
  check_error(calibration.status());
  if (!calibration.ok()) return 0;
  require(kind >= 2 || !calibration->cameras.empty(), "a calibration has a camera");
  for (const SourceCamera& camera : calibration->cameras) check_source_camera(camera);
  return 0;
}
