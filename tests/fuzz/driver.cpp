// SPDX-License-Identifier: Apache-2.0
// The plain driver of a fuzz target: runs its seeds, its committed corpus, and a fixed number of
// mutations of both, each within its memory limit. Needs no fuzzer and builds with any compiler.
//
// usage: fuzz_NAME [--corpus DIR]... [--mutations N] [--seed S] [--first I] [--seconds T]
//                  [--write-seeds DIR] [FILE...]
// With files it runs only those. A failing input is written to fuzz_NAME.failing.
#include <fcntl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

#include "heap.h"
#include "mutator.h"
#include "two_cores.h"

using namespace stgs::fuzz;

namespace {

constexpr int kSkipped = 77;                     // exit code
constexpr std::size_t kMaxInputBytes = 1 << 16;  // of a mutated input
// For C libraries, whose allocations bypass operator new. A sanitizer needs terabytes of address
// space.
constexpr rlim_t kAddressSpace = rlim_t{2} << 30;
// g++ and clang define different macros for their sanitizers.
#if defined(__has_feature)
#define STGS_HAS_FEATURE(name) __has_feature(name)
#else
#define STGS_HAS_FEATURE(name) 0
#endif
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__) || \
    STGS_HAS_FEATURE(address_sanitizer) || STGS_HAS_FEATURE(thread_sanitizer)
constexpr bool kLimitAddressSpace = false;
#else
constexpr bool kLimitAddressSpace = true;
#endif

struct Options {
  std::string write_seeds;
  std::uint64_t mutations = 1000, seed = 1, first = 0;
  double seconds = 0;
  std::vector<std::string> corpora, files;
};

// Read by the signal handler.
const std::uint8_t* current_data = nullptr;
std::size_t current_size = 0;
char failing_path[256];

extern "C" void save_failing_input(int signal_number) {
  const int file = ::open(failing_path, O_WRONLY | O_CREAT | O_TRUNC, 0644);
  if (file >= 0) {
    std::size_t done = 0;
    while (done < current_size) {
      const ssize_t written = ::write(file, current_data + done, current_size - done);
      if (written <= 0) break;
      done += static_cast<std::size_t>(written);
    }
    ::close(file);
  }
  std::signal(signal_number, SIG_DFL);
  std::raise(signal_number);
}

std::uint64_t max_heap_peak = 0;

void run_one(const Bytes& input) {
  current_data = input.data();
  current_size = input.size();
  limit_heap(kTarget.max_memory(input));
  LLVMFuzzerTestOneInput(input.data(), input.size());
  max_heap_peak = std::max(max_heap_peak, heap_peak());
  unlimit_heap();
}

Bytes read_file(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) {
    std::fprintf(stderr, "%s: cannot open\n", path.c_str());
    std::exit(2);
  }
  return {std::istreambuf_iterator<char>(file), {}};
}

std::vector<Bytes> read_folder(const std::string& folder) {
  std::vector<std::string> paths;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (entry.is_regular_file()) paths.push_back(entry.path());
  }
  std::sort(paths.begin(), paths.end());
  std::vector<Bytes> out;
  for (const std::string& path : paths) out.push_back(read_file(path));
  return out;
}

bool parse(int argc, char** argv, Options& options) {
  for (int i = 1; i < argc; ++i) {
    const std::string name = argv[i];
    if (name.rfind("--", 0) != 0) {
      options.files.push_back(name);
      continue;
    }
    if (++i == argc) return false;
    const char* const value = argv[i];
    if (name == "--corpus") {
      options.corpora.push_back(value);
    } else if (name == "--write-seeds") {
      options.write_seeds = value;
    } else if (name == "--mutations") {
      options.mutations = std::strtoull(value, nullptr, 10);
    } else if (name == "--seed") {
      options.seed = std::strtoull(value, nullptr, 10);
    } else if (name == "--first") {
      options.first = std::strtoull(value, nullptr, 10);
    } else if (name == "--seconds") {
      options.seconds = std::strtod(value, nullptr);
    } else {
      return false;
    }
  }
  return true;
}

// A mutation depends only on its number and the seed, so that it can be repeated alone.
std::uint64_t run_mutations(const std::vector<Bytes>& inputs, const Options& options) {
  using Clock = std::chrono::steady_clock;
  const auto begin = Clock::now();
  std::uint64_t done = 0;
  for (std::uint64_t i = options.first; !inputs.empty(); ++i, ++done) {
    if (options.seconds > 0) {
      if (std::chrono::duration<double>(Clock::now() - begin).count() > options.seconds) break;
    } else if (done == options.mutations) {
      break;
    }
    Random random(options.seed * 0x100000001B3 + i);
    const Bytes& base = inputs[random.below(inputs.size())];
    const Bytes& other = inputs[random.below(inputs.size())];
    run_one(mutate(kTarget, base, other, kMaxInputBytes, random));
  }
  return done;
}

void write_seeds(const std::string& folder, const std::vector<Bytes>& seeds) {
  std::filesystem::create_directories(folder);
  for (std::size_t i = 0; i < seeds.size(); ++i) {
    std::ofstream(folder + "/seed_" + std::to_string(i), std::ios::binary)
        .write(reinterpret_cast<const char*>(seeds[i].data()),
               static_cast<std::streamsize>(seeds[i].size()));
  }
}

}  // namespace

// Sanitizer reports raise SIGABRT, which the handler above catches.
extern "C" const char* __asan_default_options() {
  return "abort_on_error=1:handle_abort=0:allocator_may_return_null=1";
}
extern "C" const char* __ubsan_default_options() {
  return "abort_on_error=1:print_stacktrace=1";
}

int main(int argc, char** argv) {
  Options options;
  if (!parse(argc, argv, options)) {
    std::fprintf(stderr,
                 "usage: fuzz_%s [--corpus DIR]... [--mutations N] [--seed S] [--first I] "
                 "[--seconds T] [--write-seeds DIR] [FILE...]\n",
                 kTarget.name);
    return 1;
  }
  if (!options.write_seeds.empty()) {
    write_seeds(options.write_seeds, kTarget.seeds());
    return 0;
  }
  if (kTarget.has_device != nullptr && !kTarget.has_device()) {
    std::printf("%s: no device\n", kTarget.name);
    return kSkipped;
  }
  use_two_cores();
  if (kLimitAddressSpace && kTarget.has_device == nullptr) {  // drivers reserve much of it
    const rlimit limit{kAddressSpace, kAddressSpace};
    setrlimit(RLIMIT_AS, &limit);
  }
  std::snprintf(failing_path, sizeof failing_path, "fuzz_%s.failing", kTarget.name);
  std::signal(SIGABRT, save_failing_input);
  std::signal(SIGSEGV, save_failing_input);
  std::vector<Bytes> inputs;
  if (options.files.empty()) {
    inputs = kTarget.seeds();
    for (const std::string& folder : options.corpora) {
      for (Bytes& bytes : read_folder(folder)) inputs.push_back(std::move(bytes));
    }
  }
  for (const std::string& path : options.files) inputs.push_back(read_file(path));
  for (const Bytes& input : inputs) run_one(input);
  const std::uint64_t mutations = options.files.empty() ? run_mutations(inputs, options) : 0;
  std::printf("%s: %zu inputs, %llu mutations, at most %llu KiB of heap\n", kTarget.name,
              inputs.size(), static_cast<unsigned long long>(mutations),
              static_cast<unsigned long long>(max_heap_peak >> 10));
  return 0;
}
