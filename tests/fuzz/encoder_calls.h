// SPDX-License-Identifier: Apache-2.0
// The state and the calls of the target sdk_encoder. encoder_jobs.cpp implements the jobs;
// target_sdk_encoder.cpp maps the input to calls and checks every call.
#pragma once

#include <cstring>
#include <initializer_list>
#include <map>
#include <set>
#include <string>
#include <thread>

#include "../fixtures/synthetic_capture.h"
#include "../fixtures/temporary_folder.h"
#include "choices.h"
#include "fuzz_target.h"
#include "stgs/stgs_encoder.h"

namespace stgs::fuzz {

template <typename Settings>
Settings default_settings(stgs_result (*defaults)(Settings*, std::size_t)) {
  Settings settings;
  require(defaults(&settings, sizeof settings) == STGS_OK, "settings have defaults");
  return settings;
}

// Two iterations of few primitives on the CPU.
stgs_train_settings short_training();

// The files that every input starts with: a prepared capture, a scene trained on it, and its
// checkpoint.
struct InitialFiles {
  test::SyntheticCapture synthetic{3, 2};
  std::string scene, checkpoint;

  InitialFiles();
  const std::string& capture() const { return synthetic.folder.path; }
};
const InitialFiles& initial_files();

// Settings as they are, with another size, or null.
template <typename T>
class SettingsArgument {
 public:
  SettingsArgument(const T& value, Choices& choices)
      : value_(value), resized_(value, choices.next()) {
    kind_ = choices.next() % 8;
  }
  const T* get() { return kind_ == 1 ? nullptr : kind_ == 2 ? resized_.get() : &value_; }

 private:
  T value_;
  ResizedStruct<T> resized_;
  unsigned kind_;
};

// A report that must stay unchanged after an error; complete, of another size, or null.
template <typename T>
class ReportArgument {
 public:
  explicit ReportArgument(std::uint8_t size) {
    T untouched;
    std::memset(static_cast<void*>(&untouched), 0xA5, sizeof untouched);
    untouched.struct_size = sizeof untouched;
    value_ = before_ = untouched;
    is_null_ = size % 4 == 1;
    if (size % 4 == 2) value_.struct_size = before_.struct_size = size;
  }
  T* get() { return is_null_ ? nullptr : &value_; }
  const T& value() const { return value_; }
  bool is_complete() const { return !is_null_ && value_.struct_size == sizeof value_; }
  bool is_untouched() const { return std::memcmp(&value_, &before_, sizeof value_) == 0; }

 private:
  T value_, before_;
  bool is_null_;
};

class EncoderCalls {
 public:
  explicit EncoderCalls(View input);

 private:
  using FileContents = std::map<std::string, std::string>;  // by relative path

  void call();
  void create_encoder();
  // Returns whether to stop.
  bool on_progress(const stgs_encoder_progress& progress);
  // Runs a call on the encoder and checks its result and its files: `outputs` may change if it
  // succeeds, `others` always.
  template <typename Work>
  stgs_result run(const std::set<std::string>& outputs, const std::set<std::string>& others,
                  Work&& work) {
    const FileContents before = begin_run();
    const stgs_result result = work();
    end_run(result);
    check_files(before, result == STGS_OK ? outputs : std::set<std::string>(), others);
    return result;
  }
  FileContents begin_run();
  void end_run(stgs_result result);
  void check_files(const FileContents& before, const std::set<std::string>& outputs,
                   const std::set<std::string>& others) const;

  stgs_train_settings training_settings();
  void choose_parameters(stgs_train_settings& settings);
  void check_training();
  void train();
  stgs_pack_settings pack_settings();
  void pack();
  void prepare();

  void damage();
  void write(const std::string& name, const std::string& bytes) const;
  FileContents files() const;
  // Chooses a path in the folder (or the text after '='), valid as long as this object.
  const char* choose_path(std::initializer_list<const char*> names);

  Choices choices_;
  const testing::TemporaryFolder folder_;
  stgs_encoder* encoder_ = nullptr;
  stgs_parameter parameters_[2] = {};
  std::set<std::string> texts_;
  bool is_running_ = false, has_stopped_ = false, cancel_concurrently_ = false;
  std::thread canceller_;
  int calls_to_stop_ = 0;  // progress calls until the one that stops; 0: none stops
  std::string stage_;
  double done_ = 0;
};

}  // namespace stgs::fuzz
