// SPDX-License-Identifier: Apache-2.0
// The C interface of the encoder, called in the order and with the arguments of the input, on a
// tiny capture and on files that may be damaged. Every result is one that the header names,
// failures have messages and leave all files unchanged, and written files can be opened.
#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>
#include <thread>

#include "encoder_calls.h"
#include "sdk_hooks.h"

using namespace stgs;
using namespace stgs::fuzz;
namespace fs = std::filesystem;

namespace {

std::vector<Bytes> seeds() {
  return {// Create; check, train, pack the trained scene; destroy.
          {0, 0, 0, 4, 0, 0, 0, 5, 0, 0, 0, 0, 0, 0, 6, 0, 0, 0, 1, 1, 0, 0, 1, 0, 1, 0},
          // With parameters, and with the quality that packing loses.
          {0, 2, 1, 5, 1, 15, 0, 5,  1, 6, 2, 0, 0, 0, 0, 0,
           0, 6, 2, 5, 0, 6,  0, 15, 0, 0, 1, 0, 0, 0, 1, 0},
          // A run that is stopped and resumed from its checkpoint; two scenes packed into one.
          {0, 3, 1, 3, 1, 5, 1, 8, 3, 0, 0, 0, 0, 0, 5, 1, 10,
           3, 0, 0, 0, 0, 0, 6, 0, 0, 0, 2, 0, 1, 0, 1, 0},
          // A damaged scene, a damaged checkpoint, and a call cancelled by another thread.
          {0, 1, 1, 8, 0, 77, 6,  0, 9, 6, 0, 0, 0, 1, 0, 0, 0, 1, 0, 8, 1,
           9, 1, 0, 3, 5, 1,  10, 2, 0, 0, 0, 0, 0, 2, 5, 0, 0, 0, 0, 0, 0},
          {0, 0, 0, 7, 0, 0, 0, 0, 0, 0, 0}};
}

// Covers training and packing a few hundred primitives.
std::uint64_t max_memory(View) {
  return 256 << 20;
}

std::string read_file(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

}  // namespace

namespace stgs::fuzz {

stgs_train_settings short_training() {
  stgs_train_settings settings = default_settings(stgs_train_settings_defaults);
  settings.preset = STGS_PRESET_FAST;
  settings.backend = STGS_BACKEND_CPU;
  settings.iterations = 2;
  settings.max_primitives = 300;
  return settings;
}

InitialFiles::InitialFiles() {
  const testing::TemporaryFolder folder;
  const std::string scene_path = folder / "scene.stgs", checkpoint_path = folder / "run.ckpt";
  stgs_encoder* encoder = nullptr;
  require(stgs_encoder_create(nullptr, &encoder) == STGS_OK, "an encoder can be created");
  stgs_train_settings settings = short_training();
  settings.checkpoint = checkpoint_path.c_str();
  require(stgs_encoder_train(encoder, capture().c_str(), scene_path.c_str(), &settings, nullptr) ==
              STGS_OK,
          "a capture can be trained");
  stgs_encoder_destroy(encoder);
  scene = read_file(scene_path);
  checkpoint = read_file(checkpoint_path);
}

const InitialFiles& initial_files() {
  static const InitialFiles made;
  return made;
}

EncoderCalls::EncoderCalls(View input) : choices_(input) {
  write("scene.stgs", initial_files().scene);
  write("run.ckpt", initial_files().checkpoint);
  write("notes.txt", "no scene");
  fs::create_directory(folder_ / "empty");
  for (int k = 0; k < 12 && choices_.has_more(); ++k) call();
  stgs_encoder_destroy(encoder_);
}

// The corpus depends on these numbers.
void EncoderCalls::call() {
  switch (choices_.next() % 9) {
    case 0:
      return create_encoder();
    case 1:
      if (choices_.next() % 4 != 0) return;
      stgs_encoder_destroy(encoder_);
      encoder_ = nullptr;
      return;
    case 2:
      cancel_concurrently_ = true;
      return;
    case 3:
      calls_to_stop_ = 1 + choices_.next() % 8;
      return;
    case 4:
      return check_training();
    case 5:
      return train();
    case 6:
      return pack();
    case 7:
      return prepare();
    default:
      return damage();
  }
}

void EncoderCalls::create_encoder() {
  stgs_encoder_settings settings = default_settings(stgs_encoder_settings_defaults);
  constexpr std::uint32_t kThreads[] = {0, 1, 2, 3, 1024, 1025, UINT32_MAX};
  settings.threads = choices_.pick(kThreads);
  const std::uint8_t hooks = choices_.next();
  if ((hooks & 1) != 0) settings.log = check_log_line;
  settings.progress_user = this;
  settings.progress = [](void* user, const stgs_encoder_progress* progress) -> std::int32_t {
    return static_cast<EncoderCalls*>(user)->on_progress(*progress) ? 1 : 0;
  };
  stgs_encoder_destroy(encoder_);
  stgs_result result = STGS_OK;
  if ((hooks & 0xE) == 0xE) {
    ResizedStruct<stgs_encoder_settings> resized(settings, hooks >> 4);
    result = stgs_encoder_create(resized.get(), &encoder_);
  } else {
    result = stgs_encoder_create(&settings, &encoder_);
  }
  require((result == STGS_OK) == (encoder_ != nullptr), "creation returns an encoder or an error");
  calls_to_stop_ = 0;
}

bool EncoderCalls::on_progress(const stgs_encoder_progress& progress) {
  require(is_running_, "progress is reported only during a call");
  require(!has_stopped_, "no progress is reported after a stop");
  require(progress.struct_size == sizeof progress && progress.stage != nullptr &&
              progress.stage[0] != '\0' && progress.detail != nullptr,
          "progress has a stage and a detail");
  if (stage_ != progress.stage) done_ = 0;
  stage_ = progress.stage;
  require(progress.done >= done_ && progress.done <= 1, "the progress of a stage never decreases");
  done_ = progress.done;
  has_stopped_ = calls_to_stop_ > 0 && --calls_to_stop_ == 0;
  return has_stopped_;
}

EncoderCalls::FileContents EncoderCalls::begin_run() {
  FileContents before = files();
  is_running_ = true;
  has_stopped_ = false;
  stage_.clear();
  if (cancel_concurrently_) canceller_ = std::thread(stgs_encoder_cancel, encoder_);
  return before;
}

void EncoderCalls::end_run(stgs_result result) {
  if (canceller_.joinable()) canceller_.join();
  cancel_concurrently_ = is_running_ = false;
  require(std::string(stgs_result_name(result)) != "unknown result", "a result has a name");
  stgs_error error{};
  error.struct_size = sizeof error;
  if (stgs_encoder_error(encoder_, &error) == STGS_OK) {
    require(error.result == result, "the error is that of the last call");
    require((result == STGS_OK) == (error.message[0] == '\0'), "an error has a message");
  }
}

void EncoderCalls::check_files(const FileContents& before, const std::set<std::string>& outputs,
                               const std::set<std::string>& others) const {
  const auto may_change = [&](const std::string& name) {
    return outputs.count(folder_ / name) != 0 || others.count(folder_ / name) != 0;
  };
  const FileContents after = files();
  for (const auto& [name, bytes] : after) {
    if (may_change(name)) continue;
    const auto old = before.find(name);
    require(old != before.end() && old->second == bytes, "a call writes only its outputs");
  }
  for (const auto& [name, bytes] : before) {
    require(after.count(name) != 0, "a call removes no file");
  }
}

// Changes a byte of a file or truncates it.
void EncoderCalls::damage() {
  const std::string name = choices_.next() % 2 == 0 ? "scene.stgs" : "run.ckpt";
  std::string bytes = read_file(folder_ / name);
  const std::size_t offset = choices_.next() + std::size_t{256} * choices_.next();
  if (bytes.empty()) return;
  if (choices_.next() % 4 == 1) {
    bytes.resize(offset % bytes.size());
  } else {
    bytes[offset % bytes.size()] = static_cast<char>(choices_.next());
  }
  write(name, bytes);
}

void EncoderCalls::write(const std::string& name, const std::string& bytes) const {
  std::ofstream(folder_ / name, std::ios::binary)
      .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

EncoderCalls::FileContents EncoderCalls::files() const {
  FileContents out;
  for (const auto& entry : fs::recursive_directory_iterator(folder_.path)) {
    out[fs::relative(entry.path(), folder_.path)] =
        entry.is_regular_file() ? read_file(entry.path()) : "folder";
  }
  return out;
}

const char* EncoderCalls::choose_path(std::initializer_list<const char*> names) {
  const char* const name = *(names.begin() + choices_.next() % names.size());
  if (name == nullptr) return nullptr;
  if (*name == '\0') return "";
  return texts_.insert(name[0] == '=' ? name + 1 : folder_ / name).first->c_str();
}

}  // namespace stgs::fuzz

const Target stgs::fuzz::kTarget{"sdk_encoder", seeds, nullptr, nullptr, nullptr, max_memory};

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  (void)initial_files();
  EncoderCalls({data, std::min<std::size_t>(size, 256)});
  return 0;
}
