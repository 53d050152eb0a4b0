// SPDX-License-Identifier: Apache-2.0
// Sources whose reads fail, files that change under a reader, and the limits of a caller.
#include <atomic>
#include <filesystem>
#include <fstream>

#include "catch.h"
#include "fixtures/scene_fixture.h"
#include "fixtures/temporary_folder.h"
#include "head_fixture.h"
#include "scene/recording.h"
#include "stgs/format/scene_recorder.h"

using namespace stgs;
using namespace stgs::testing;
using Bytes = std::vector<std::uint8_t>;
namespace fs = std::filesystem;

namespace {

Bytes vector_named(const std::string& name) {
  const std::string path =
      std::string(STGS_TEST_DATA) + "/../conformance/vectors/" + name + ".stgs";
  std::ifstream file(path, std::ios::binary);
  REQUIRE(file);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

// A source whose reads succeed a given number of times and then fail: all, or one of them.
class FailingSource final : public ByteSource {
 public:
  FailingSource(Bytes bytes, std::shared_ptr<std::atomic<int>> reads_left, bool once = false)
      : bytes_(std::move(bytes)), reads_left_(std::move(reads_left)), once_(once) {}
  std::uint64_t size() const override { return bytes_.size(); }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    const int left = reads_left_->fetch_sub(1);
    if (once_ ? left == 0 : left <= 0) return io_error("{}: the disk is gone", name_);
    REQUIRE((offset <= bytes_.size() && out.size() <= bytes_.size() - offset));
    std::copy_n(bytes_.begin() + static_cast<std::ptrdiff_t>(offset), out.size(), out.begin());
    return {};
  }
  const std::string& name() const override { return name_; }

 private:
  Bytes bytes_;
  std::shared_ptr<std::atomic<int>> reads_left_;
  bool once_ = false;
  std::string name_ = "failing";
};

std::unique_ptr<ByteSource> failing(const Bytes& bytes, int reads) {
  return std::make_unique<FailingSource>(bytes, std::make_shared<std::atomic<int>>(reads));
}

// Decodes every segment, and reads the importance of the primitives.
Status read_all(std::unique_ptr<ByteSource> source) {
  STGS_ASSIGN(const auto reader, SceneReader::open(std::move(source)));
  for (std::uint32_t s = 0; s < reader->segments().size(); ++s) {
    STGS_TRY(reader->decode(s).status());
    STGS_TRY(reader->read(s, true).status());
  }
  return reader->importance().status();
}

// Returns the number of reads that a call needs to succeed. With fewer, it must report the I/O
// error.
template <typename Call>
int reads_needed(const Call& call) {
  constexpr int kMany = 1000;
  for (int reads = 0; reads < kMany; ++reads) {
    const Status status = call(reads);
    if (status.ok()) return reads;
    INFO(reads << " reads: " << status.message());
    REQUIRE(status.code() == StatusCode::kIo);
    REQUIRE(status.message().find("the disk is gone") != std::string::npos);
  }
  return kMany;
}

constexpr const char* kVectors[] = {"tiers",
                                    "importance",
                                    "parts",
                                    "private_names",
                                    "further_alone",
                                    "growing",
                                    "growing_closed",
                                    "growing_cut_in_a_fragment",
                                    "growing_further_records"};

}  // namespace

TEST_CASE("a group without planes is checked before the segment is decoded or passed on") {
  const auto reader = SceneReader::open(memory_source(vector_named("unit_of_no_planes")));
  REQUIRE(reader.ok());
  CHECK_FALSE((*reader)->decode(0).ok());
  CHECK((*reader)->read(0, true).status().code() == StatusCode::kInvalidFile);
  const auto valid = SceneReader::open(memory_source(vector_named("group_of_no_planes")));
  REQUIRE(valid.ok());
  CHECK((*valid)->read(0, true).ok());
}

TEST_CASE("a failure of any read is reported as an I/O error") {
  for (const char* name : kVectors) {
    INFO(name);
    const Bytes bytes = vector_named(name);
    const auto read = [&](int reads) { return read_all(failing(bytes, reads)); };
    const int needed = reads_needed(read);
    CHECK(needed > 2);
    CHECK(needed < 200);
    // The validator reports the part that it could not read, as issue 100 if there are others. It
    // reads no more: a failed read ahead is tried once more without the bytes ahead.
    const auto validate = [&](int reads) -> Status {
      const auto left = std::make_shared<std::atomic<int>>(reads);
      const auto validated = validate_scene(FailingSource(bytes, left));
      CHECK(*left >= -2);
      STGS_ASSIGN(const auto issues, validated);
      for (const Issue& issue : issues) {
        if (issue.number == 100) return {StatusCode::kIo, issue.message};
      }
      return {};
    };
    CHECK(reads_needed(validate) > 2);
  }
}

TEST_CASE("finalize writes no file if its source fails") {
  const testing::TemporaryFolder folder;
  const std::string output = folder / "closed.stgs";
  for (const char* name : {"growing_closed", "growing_further_records", "growing_17"}) {
    INFO(name);
    const Bytes bytes = vector_named(name);
    const int needed = reads_needed([&](int reads) {
      DamageReport damage;
      const Status status = finalize_scene(failing(bytes, reads), output, damage);
      CHECK(fs::exists(output) == status.ok());
      return status;
    });
    CHECK(needed > 5);
    fs::remove(output);
  }
}

TEST_CASE("a read that fails once does not count as damage of a recording") {
  const Bytes bytes = vector_named("growing_17");
  const auto resume = [&](int reads) {
    const auto left = std::make_shared<std::atomic<int>>(reads);
    return read_resumable(FailingSource(bytes, left, true)).status();
  };
  CHECK(reads_needed(resume) > 17);
}

TEST_CASE("only an intact growing recording can be resumed") {
  const testing::TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  const auto resumed = [&](const char* name) {
    const Bytes bytes = vector_named(name);
    std::ofstream(path, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()),
               static_cast<std::streamsize>(bytes.size()));
    const Status status = SceneRecorder::resume(path).status();
    fs::remove(path);
    return status;
  };
  CHECK(resumed("growing").ok());
  CHECK(resumed("growing_lasting").ok());
  CHECK(resumed("growing_further_records").ok());
  CHECK(resumed("fragment_damaged").code() == StatusCode::kInvalidFile);
  CHECK(resumed("growing_closed").code() == StatusCode::kUsage);
  CHECK(resumed("levels").code() == StatusCode::kUsage);
}

namespace {

// A source whose bytes change under its reader.
class ChangingSource final : public ByteSource {
 public:
  explicit ChangingSource(std::shared_ptr<Bytes> bytes) : bytes_(std::move(bytes)) {}
  std::uint64_t size() const override { return bytes_->size(); }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    if (offset > bytes_->size() || out.size() > bytes_->size() - offset) {
      return io_error("{}: has become shorter", name_);
    }
    std::copy_n(bytes_->begin() + static_cast<std::ptrdiff_t>(offset), out.size(), out.begin());
    return {};
  }
  const std::string& name() const override { return name_; }

 private:
  std::shared_ptr<Bytes> bytes_;
  std::string name_ = "changing";
};

}  // namespace

TEST_CASE("a recording that shrinks is an error, and the reader keeps its state") {
  const auto bytes = std::make_shared<Bytes>(vector_named("growing"));
  const auto reader = SceneReader::open(std::make_unique<ChangingSource>(bytes));
  REQUIRE(reader.ok());
  const std::size_t segments = (*reader)->segments().size();
  const auto again = (*reader)->refresh();
  REQUIRE(again.ok());
  CHECK_FALSE(*again);
  bytes->resize(bytes->size() - 1);
  CHECK((*reader)->refresh().status().code() == StatusCode::kInvalidFile);
  CHECK((*reader)->segments().size() == segments);
  bytes->resize(20);
  CHECK_FALSE((*reader)->refresh().ok());
  CHECK((*reader)->metadata().frames == 30);
  CHECK((*reader)->decode(static_cast<std::uint32_t>(segments)).status().code() ==
        StatusCode::kUsage);
}

TEST_CASE("the memory limit applies to a complete read, and the validator reports larger records") {
  Scene scene = random_scene(400, 1, 30, 7);
  scene.importance.assign(400, 1.0f);
  for (float& sigma : scene.gaussians.sigma) sigma = 0.5f;  // in many segments
  for (float& radius : scene.gaussians.radius) radius = 0.0f;
  WriteSettings settings;
  settings.chunk_seconds = 0.1;
  settings.coder = SceneCoder::kBytes;  // without tables, which need memory
  const auto bytes = encode_scene(scene, settings);
  REQUIRE(bytes.ok());
  ReadLimits limits;
  limits.max_memory = 400 * 4 * 29 - 1;  // enough for each segment, not for all primitives
  CHECK(SceneReader::open(memory_source(*bytes), limits).ok());
  const Status all = read_scene(memory_source(*bytes), limits).status();
  CHECK(all.code() == StatusCode::kUnsupported);
  CHECK(all.message().find("400 primitives need ") != std::string::npos);

  const Bytes small = vector_named("importance");
  const FileHead head = head_of(small);
  Bytes body = body_of(small);
  const Bytes large = write_record(tag_of("NOTE"), Bytes(20000), 0);
  body.insert(body.end(), large.begin(), large.end());
  Bytes file(small.begin(), small.begin() + static_cast<std::ptrdiff_t>(head.header.head_bytes));
  FileHeader header = head.header;
  header.file_bytes += large.size();
  const Bytes first = write_header(header);
  std::copy(first.begin(), first.end(), file.begin());
  file.insert(file.end(), body.begin(), body.end());
  limits.max_memory = 19999;
  const auto reader = SceneReader::open(memory_source(file), limits);
  REQUIRE(reader.ok());
  CHECK((*reader)->importance().ok());
  const auto issues = validate_scene(*memory_source(file), limits);
  REQUIRE(issues.ok());
  REQUIRE(issues->size() == 1);
  CHECK(issues->front().number == 308);
  CHECK(validate_scene(*memory_source(file), {})->empty());
}

TEST_CASE("a scene that the format cannot represent is not written") {
  const Scene good = random_scene(5, 1, 30, 3);
  const auto is_rejected = [](const Scene& scene, const WriteSettings& settings) {
    return encode_scene(scene, settings).status().code() == StatusCode::kUsage;
  };
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  CHECK_FALSE(is_rejected(good, settings));
  for (const int tiers : {-1, 17}) {
    settings.tiers = tiers;
    CHECK(is_rejected(good, settings));
  }
  settings.tiers = 3;
  Scene scene = good;
  scene.gaussians.position[4] = 0x1p100f;
  CHECK(encode_scene(scene, settings).status().code() == StatusCode::kUnsupported);
  CHECK_FALSE(is_rejected(scene, {}));
  scene = good;
  scene.gaussians.sh_degree = 4;
  CHECK(is_rejected(scene, {}));
  scene = good;
  scene.importance = {1, 2, -1, 4, 5};
  CHECK(is_rejected(scene, {}));
  scene = good;
  scene.metadata.audio_begin = INFINITY;
  CHECK(is_rejected(scene, {}));
  scene = good;
  scene.parts = {{-1, 0x1p32, 5}};
  CHECK(is_rejected(scene, {}));
  settings.profile = Profile::kUnknown;
  CHECK(is_rejected(good, settings));
}
