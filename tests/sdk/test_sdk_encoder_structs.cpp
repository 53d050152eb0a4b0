// SPDX-License-Identifier: Apache-2.0
// Every struct of the encoder's C API, shorter and longer than in this version's headers.
#include <unistd.h>

#include <cstddef>

#include "fixtures/synthetic_capture.h"
#include "stgs/format/status.h"
#include "stgs/stgs_encoder.h"
#include "struct_sizes.h"

namespace stgs::testing {
namespace {

struct DestroyEncoder {
  void operator()(stgs_encoder* encoder) const { stgs_encoder_destroy(encoder); }
};
using EncoderPtr = std::unique_ptr<stgs_encoder, DestroyEncoder>;

stgs_result create(const stgs_encoder_settings* settings) {
  stgs_encoder* encoder = nullptr;
  const stgs_result result = stgs_encoder_create(settings, &encoder);
  stgs_encoder_destroy(encoder);
  return result;
}

// The settings are checked before the paths: an error about the paths means that the settings are
// valid.
stgs_result ok_if(stgs_result result, stgs_result expected) {
  return result == expected ? STGS_OK : result;
}

}  // namespace

TEST_CASE("the encoder accepts structs of older and newer headers", "[sdk]") {
  const test::SyntheticCapture synthetic(3, 2);
  const std::string& folder = synthetic.capture.folder;
  const std::string scene = folder + "/scene.stgs", packed = folder + "/packed.stgs";
  const std::string checkpoint = folder + "/run.ckpt";
  std::size_t progress_size = 0;
  stgs_encoder_settings settings = defaults_of(stgs_encoder_settings_defaults);
  check_input_struct("stgs_encoder_settings", settings, 16, create);
  settings.progress_user = &progress_size;
  settings.progress = [](void* user, const stgs_encoder_progress* progress) -> std::int32_t {
    *static_cast<std::size_t*>(user) = progress->struct_size;
    return 0;
  };
  stgs_encoder* created = nullptr;
  REQUIRE(stgs_encoder_create(&settings, &created) == STGS_OK);
  const EncoderPtr encoder(created);

  stgs_train_settings training = defaults_of(stgs_train_settings_defaults);
  training.preset = STGS_PRESET_FAST;
  training.backend = STGS_BACKEND_CPU;
  check_input_struct("stgs_train_settings", training, 16, [&](const stgs_train_settings* s) {
    return stgs_encoder_check_training(encoder.get(), s);
  });
  // Resumes a finished run, so that every report is the same.
  training.iterations = 3;
  training.max_primitives = 100;
  training.checkpoint = checkpoint.c_str();
  REQUIRE(stgs_encoder_train(encoder.get(), folder.c_str(), scene.c_str(), &training, nullptr) ==
          STGS_OK);
  training.resume = checkpoint.c_str();
  check_output_struct<stgs_train_report>("stgs_train_report", [&](stgs_train_report* report) {
    return stgs_encoder_train(encoder.get(), folder.c_str(), scene.c_str(), &training, report);
  });
  CHECK(progress_size == sizeof(stgs_encoder_progress));

  const auto pack = [&](const stgs_pack_settings* s, stgs_pack_report* report) {
    return stgs_encoder_pack(encoder.get(), scene.c_str(), packed.c_str(), s, report);
  };
  check_input_struct("stgs_pack_settings", defaults_of(stgs_pack_settings_defaults), 16,
                     [&](const stgs_pack_settings* s) { return pack(s, nullptr); });
  check_output_struct<stgs_pack_report>(
      "stgs_pack_report", [&](stgs_pack_report* report) { return pack(nullptr, report); });

  const stgs_prepare_settings preparing = defaults_of(stgs_prepare_settings_defaults);
  const std::string none = folder + "/none", out = folder + "/out";
#ifdef STGS_HAS_PREPARE
  constexpr stgs_result kMissing = STGS_ERROR_IO;
#else
  constexpr stgs_result kMissing = STGS_ERROR_NOT_BUILT;
#endif
  check_input_struct("stgs_prepare_settings", preparing, 16, [&](const stgs_prepare_settings* s) {
    return ok_if(stgs_encoder_prepare(encoder.get(), none.c_str(), out.c_str(), s, nullptr),
                 kMissing);
  });
  // test_sdk_encoder.cpp covers stgs_prepare_report.
  std::set<std::string> declared = sized_structs(STGS_SDK_HEADERS "/stgs_encoder.h");
  declared.merge(sized_structs(STGS_SDK_HEADERS "/stgs_encoder_recorder.h"));
  CHECK(declared ==
        std::set<std::string>{"stgs_encoder_progress", "stgs_encoder_settings",
                              "stgs_prepare_settings", "stgs_prepare_report", "stgs_train_settings",
                              "stgs_train_report", "stgs_pack_settings", "stgs_pack_report",
                              // Covered by test_sdk_recorder.cpp.
                              "stgs_record_settings", "stgs_fragment", "stgs_recorder_status"});
}

}  // namespace stgs::testing
