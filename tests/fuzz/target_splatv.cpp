// SPDX-License-Identifier: Apache-2.0
// .splatv: magic, JSON, records of 64 bytes.
#include "../fixtures/splatv_fixture.h"

#include <cstring>

#include "imported.h"
#include "stgs/format/splatv.h"

using namespace stgs;
using namespace stgs::fuzz;

namespace {

constexpr std::size_t kHead = 8;

std::vector<Bytes> seeds() {
  testing::SplatvRecord translating, rotating;
  translating.position = {1, 2, 3};
  translating.motion = {0.5f, 0, 0, 0, 0.25f, 0, 0, 0, 0.125f};
  rotating.rotation_motion = {0, 1, 0, 0};
  rotating.centre = 0.25f;
  const std::string one = testing::splatv_file({translating}),
                    three = testing::splatv_file({translating, rotating, {}});
  return {Bytes(one.begin(), one.end()), Bytes(three.begin(), three.end())};
}

std::size_t json_end(View form) {
  std::uint32_t size = 0;
  if (form.size() < kHead) return form.size();
  std::memcpy(&size, form.data() + 4, sizeof size);
  return kHead + std::min<std::size_t>(size, form.size() - kHead);
}

std::vector<Unit> units(View form) {
  std::vector<Unit> out = {{0, std::min(kHead, form.size())}};
  const std::size_t end = json_end(form);
  if (end > kHead) out.push_back({kHead, end});
  for (std::size_t at = end; at + 64 <= form.size() && out.size() < 6; at += 64)
    out.push_back({at, at + 64});
  return out;
}

// Sets the size of the JSON so that it ends at the last bracket.
Bytes repair(Bytes form, Repair repair) {
  if (repair != Repair::kSizes || form.size() < kHead) return form;
  for (std::size_t i = form.size(); i-- > kHead;) {
    if (form[i] != ']') continue;
    const auto size = static_cast<std::uint32_t>(i + 1 - kHead);
    std::memcpy(form.data() + 4, &size, sizeof size);
    break;
  }
  return form;
}

}  // namespace

const Target stgs::fuzz::kTarget{"splatv", seeds, nullptr, repair, units, import_memory};

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  ConversionNotes notes;
  SplatvReport report;
  const auto scene = read_splatv(*memory_source(Bytes(data, data + size), "input"), {},
                                 kImportLimits, &report, &notes);
  check_import(scene);
  if (scene.ok()) {
    require(report.primitives == scene->gaussians.size(), "the report counts the primitives");
    require(std::isfinite(report.path_max) && std::isfinite(report.path_rms),
            "the report is finite");
  }
  return 0;
}
