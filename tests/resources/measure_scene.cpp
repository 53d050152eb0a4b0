// SPDX-License-Identifier: Apache-2.0
// Measures memory and time of opening, validating and reading files.
//
// usage: measure_scene MEMORY FILE...   MEMORY: the limit of decoding, bytes
// For each file and step it prints: file, step, status (ok, or the exit code of the problem), bytes
// of the file, bytes read, peak of the heap above its size before the step, CPU seconds. Counts
// allocations through operator new; measure_scene is single-threaded except for decoding.
#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <memory>
#include <string>
#include <vector>

#include "../fuzz/heap.h"
#include "stgs/format/scene_file.h"

namespace stgs {
namespace {

constexpr int kPrimitiveLimit = 307, kMemoryLimit = 308;  // numbers of issues
constexpr std::uint64_t kNoHeapLimit = std::uint64_t{1} << 60;

// Counts the bytes that are read from another source.
class CountingSource final : public ByteSource {
 public:
  CountingSource(std::unique_ptr<ByteSource> source, std::atomic<std::uint64_t>& bytes)
      : source_(std::move(source)), bytes_(bytes) {}
  std::uint64_t size() const override { return source_->size(); }
  const std::string& name() const override { return source_->name(); }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    bytes_ += out.size();
    return source_->read(offset, out);
  }

 private:
  std::unique_ptr<ByteSource> source_;
  std::atomic<std::uint64_t>& bytes_;
};

// Runs `step`, which takes a source and returns a Status, on a file and prints its figures.
template <typename Step>
void measure(const char* path, const char* name, const Step& step) {
  std::atomic<std::uint64_t> read{0};
  Result<std::unique_ptr<ByteSource>> file = open_file(path);
  if (!file.ok()) {
    std::fprintf(stderr, "%s\n", file.status().message().c_str());
    return;
  }
  const std::uint64_t bytes = (*file)->size();
  auto source = std::make_unique<CountingSource>(std::move(*file), read);
  fuzz::limit_heap(kNoHeapLimit);
  const std::clock_t begin = std::clock();
  const Status status = step(std::move(source));
  const double seconds = static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC;
  std::printf("%s %s %d %llu %llu %llu %.6f\n", path, name, static_cast<int>(status.code()),
              static_cast<unsigned long long>(bytes), static_cast<unsigned long long>(read.load()),
              static_cast<unsigned long long>(fuzz::heap_peak()), seconds);
}

// Returns the status of the validation, or that of its first error.
Status validate(const ByteSource& source, const ReadLimits& limits) {
  STGS_ASSIGN(const std::vector<Issue> issues, validate_scene(source, limits));
  for (const Issue& issue : issues) {
    if (!issue.error) continue;
    const bool limit = issue.number == kPrimitiveLimit || issue.number == kMemoryLimit;
    return Status(limit ? StatusCode::kUnsupported : StatusCode::kInvalidFile, issue.message);
  }
  return {};
}

}  // namespace
}  // namespace stgs

int main(int argc, char** argv) {
  using Source = std::unique_ptr<stgs::ByteSource>;
  stgs::ReadLimits limits;
  if (argc > 1) limits.max_memory = std::strtoull(argv[1], nullptr, 10);
  for (int i = 2; i < argc; ++i) {
    stgs::measure(argv[i], "open", [](Source source) {
      return stgs::SceneReader::open(std::move(source)).status();
    });
    stgs::measure(argv[i], "validate",
                  [&](Source source) { return stgs::validate(*source, limits); });
    stgs::measure(argv[i], "read", [&](Source source) {
      return stgs::read_scene(std::move(source), limits).status();
    });
  }
}
