// SPDX-License-Identifier: Apache-2.0
// The zip archives that the page reads (sdk/web/core/zip_members.h), written by libzip. zlib
// decodes in place of the browser.
#include <zlib.h>

#include <algorithm>
#include <fstream>
#include <random>

#include "catch.h"
#include "fixtures/sog_fixture.h"
#include "fixtures/temporary_folder.h"
#include "zip_members.h"

using namespace stgs;
using Bytes = std::vector<std::uint8_t>;

namespace {

Bytes archive_of(const testing::SogModel& model) {
  const testing::TemporaryFolder folder;
  model.write_bundle(folder / "model.sog");
  std::ifstream file(folder / "model.sog", std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

// Does all tasks, as far as their input is valid. Returns how many there were.
int decode_all(web::HostDecoding& decoding) {
  int count = 0;
  for (const web::DecodeTask* task = decoding.next(); task != nullptr; task = decoding.next()) {
    CHECK(task->coding == web::Coding::kDeflate);
    z_stream stream{};
    REQUIRE(inflateInit2(&stream, -MAX_WBITS) == Z_OK);
    stream.next_in = const_cast<Bytef*>(task->input);
    stream.avail_in = task->input_bytes;
    stream.next_out = task->output;
    stream.avail_out = task->output_bytes;
    inflate(&stream, Z_FINISH);
    inflateEnd(&stream);
    ++count;
  }
  return count;
}

}  // namespace

TEST_CASE("an archive of the page has the members that libzip wrote") {
  const testing::SogModel model = testing::random_sog(300, 1, 9);
  const Bytes archive = archive_of(model);
  ImportMemory memory({}, "model.sog");
  web::HostDecoding decoding;
  auto files = web::ZipMembers::open(archive, "model.sog", decoding, memory);
  REQUIRE(files.ok());
  const int deflated = decode_all(decoding);
  CHECK(deflated >= 1);  // meta.json
  CHECK(deflated < static_cast<int>(model.all_files().size()));
  for (const auto& [name, content] : model.all_files()) {
    const auto bytes = (*files)->read(name, memory, content.size());
    INFO(name << ": " << bytes.status().message());
    REQUIRE(bytes.ok());
    CHECK(std::equal(content.begin(), content.end(), bytes->value.begin(), bytes->value.end(),
                     [](char a, std::uint8_t b) { return static_cast<std::uint8_t>(a) == b; }));
  }
  CHECK((*files)->content("other").status().code() == StatusCode::kInvalidFile);
  CHECK((*files)->read("meta.json", memory, 100).status().code() == StatusCode::kUnsupported);
}

TEST_CASE("a damaged archive of the page is rejected") {
  const testing::SogModel model = testing::random_sog(300, 1, 9);
  const Bytes archive = archive_of(model);
  std::mt19937 random(3);
  int rejected = 0;
  for (int i = 0; i < 300; ++i) {
    Bytes damaged = archive;
    if (i % 10 == 0) {
      damaged.resize(random() % damaged.size());
    } else {
      for (int k = 0; k < 20; ++k) {
        damaged[damaged.size() - 1 - random() % std::min<std::size_t>(damaged.size(), 700)] =
            static_cast<std::uint8_t>(random());
      }
    }
    ReadLimits limits;
    limits.max_memory = 64 << 20;
    ImportMemory memory(limits, "damaged");
    web::HostDecoding decoding;
    auto files = web::ZipMembers::open(damaged, "damaged", decoding, memory);
    if (!files.ok()) {
      ++rejected;
      continue;
    }
    decode_all(decoding);
    for (const auto& [name, content] : model.all_files()) {
      const auto bytes = (*files)->content(name);
      rejected += bytes.ok() ? 0 : 1;
      if (bytes.ok()) CHECK(bytes->size() == content.size());
    }
  }
  CHECK(rejected > 200);
}

TEST_CASE("a member of an archive of the page stays within the memory limit") {
  testing::SogModel model;
  model.files["bomb"] = std::string(1 << 20, 'a');
  const Bytes archive = archive_of(model);
  ReadLimits limits;
  limits.max_memory = 1 << 16;
  ImportMemory memory(limits, "bomb.sog");
  web::HostDecoding decoding;
  const auto refused = web::ZipMembers::open(archive, "bomb.sog", decoding, memory);
  CHECK(refused.status().code() == StatusCode::kUnsupported);
  CHECK_THAT(refused.status().message(), Catch::Contains("memory limit of 65536 bytes"));
  CHECK(decoding.next() == nullptr);
}
