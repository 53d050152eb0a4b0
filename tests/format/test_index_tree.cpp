// SPDX-License-Identifier: Apache-2.0
// The tree of an index: what opening reads, loading on demand, and damaged nodes (spec 5.2, 10.1).
#include <algorithm>
#include <limits>
#include <set>

#include "catch.h"
#include "container/body_plan.h"
#include "fixtures/recording_fixture.h"
#include "head_fixture.h"
#include "stgs/format/listed_segment.h"

using namespace stgs;
using namespace stgs::testing;
using Bytes = std::vector<std::uint8_t>;

namespace {

constexpr std::uint32_t kFrames = 20000, kPrimitives = 12000;
constexpr double kAlways = std::numeric_limits<double>::infinity();

// A scene with thousands of segments: short lifespans all over a long timeline.
Scene long_scene() {
  Scene scene = random_scene(kPrimitives, 0, kFrames, 11);
  std::mt19937 random(4);
  std::uniform_real_distribution<float> uniform(0.0f, 1.0f);
  for (std::size_t i = 0; i < scene.gaussians.size(); ++i) {
    scene.gaussians.time[i] = kFrames * uniform(random);
    scene.gaussians.sigma[i] = 0.5f;
    scene.gaussians.radius[i] = 0;
    scene.gaussians.opacity_logit[i] = 3;
  }
  return scene;
}

Bytes long_file() {
  static const Bytes bytes = [] {
    WriteSettings settings;
    settings.chunk_seconds = 0.2;
    auto encoded = encode_scene(long_scene(), settings);
    REQUIRE(encoded.ok());
    return std::move(*encoded);
  }();
  return bytes;
}

// Counts the bytes that are read.
class CountedSource final : public ByteSource {
 public:
  CountedSource(Bytes bytes, std::uint64_t& count)
      : source_(memory_source(std::move(bytes))), count_(count) {}
  std::uint64_t size() const override { return source_->size(); }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    count_ += out.size();
    return source_->read(offset, out);
  }
  const std::string& name() const override { return source_->name(); }

 private:
  std::unique_ptr<ByteSource> source_;
  std::uint64_t& count_;
};

std::unique_ptr<SceneReader> open_on_demand(std::unique_ptr<ByteSource> source) {
  auto reader = SceneReader::open(std::move(source), {}, std::pmr::get_default_resource(),
                                  IndexLoading::kOnDemand);
  INFO(reader.status().message());
  REQUIRE(reader.ok());
  return std::move(*reader);
}

// The records of the segments at a time.
std::set<std::uint64_t> offsets_at(const SceneReader& reader, double t) {
  std::set<std::uint64_t> out;
  for (const std::uint32_t s : reader.segments_between(t, t))
    out.insert(reader.segments()[s].offset);
  return out;
}

// The links of the root of a finished file.
std::vector<NodeLink> root_links(const Bytes& bytes) {
  Findings findings;
  FileHead head;
  REQUIRE(read_head(*memory_source(bytes), {}, IndexLoading::kOnDemand, head, findings));
  std::vector<NodeLink> out;
  for (const IndexWalk::Link& one : head.walk.pending) out.push_back(one.link);
  return out;
}

std::set<int> numbers_of(const std::vector<Issue>& issues) {
  std::set<int> out;
  for (const Issue& issue : issues) out.insert(issue.number);
  return out;
}

}  // namespace

TEST_CASE("a long file is opened with 16 KiB, and loading gives the segments of a time") {
  const Bytes bytes = long_file();
  CHECK(issues_of(bytes).empty());
  const auto complete = SceneReader::open(memory_source(bytes));
  REQUIRE(complete.ok());
  REQUIRE((*complete)->segments().size() > 2500);
  std::uint64_t count = 0;
  const auto reader = open_on_demand(std::make_unique<CountedSource>(bytes, count));
  CHECK(count <= 16384 + kHeaderBytes);
  CHECK(reader->primitives() == kPrimitives);
  CHECK_FALSE(reader->is_loaded(0, kFrames));
  for (const double t : {12000.0, 0.0, 12003.0, double{kFrames}, 7777.5}) {
    const std::uint64_t before = count;
    const bool known = reader->is_loaded(t, t);
    REQUIRE(reader->load(t, t).ok());
    CHECK(known == (count == before));
    CHECK(count - before < 3 * 16384);
    CHECK(reader->is_loaded(t, t));
    CHECK(offsets_at(*reader, t) == offsets_at(**complete, t));
  }
  CHECK(reader->segments().size() < (*complete)->segments().size());
  // The numbers of the segments stay, and everything is found in the end.
  const std::vector<SegmentInfo> first = reader->segments();
  REQUIRE(reader->load(-kAlways, kAlways).ok());
  CHECK(reader->unloaded().empty());
  REQUIRE(reader->segments().size() == (*complete)->segments().size());
  for (std::size_t s = 0; s < first.size(); ++s)
    CHECK(reader->segments()[s].offset == first[s].offset);
  CHECK(reader->damage().empty());
  CHECK(reader->decode(static_cast<std::uint32_t>(first.size())).ok());
}

TEST_CASE("a reader without the index decodes segments that another one lists") {
  const Bytes bytes = long_file();
  const auto complete = SceneReader::open(memory_source(bytes));
  REQUIRE(complete.ok());
  const auto reader = open_on_demand(memory_source(bytes));
  const auto last = static_cast<std::uint32_t>((*complete)->segments().size() - 1);
  REQUIRE(reader->segments().size() <= last);
  for (const std::uint32_t segment : {last, 0U, last / 2}) {
    ListedSegment::of(**complete, segment).replace_segments(*reader);
    CHECK(reader->render_origin(segment) == (*complete)->render_origin(segment));
    const auto expected = (*complete)->decode(segment), decoded = reader->decode(segment);
    REQUIRE(expected.ok());
    REQUIRE(decoded.ok());
    CHECK(decoded->position == expected->position);
    CHECK(decoded->time == expected->time);
    CHECK_FALSE(reader->decode(segment + 1).ok());
  }
}

TEST_CASE("the order that the writer returns is that of the primitives that are read") {
  Scene scene = long_scene();
  scene.importance.assign(scene.gaussians.size(), 0.0f);
  for (std::size_t i = 0; i < scene.importance.size(); ++i)
    scene.importance[i] = static_cast<float>(i);
  scene.parts = {{0, 12000, 4500}, {8000, kFrames, 7500, TickRange{9000, kFrames}}};
  for (std::size_t i = 0; i < scene.gaussians.size(); ++i)
    scene.gaussians.time[i] = std::fmod(scene.gaussians.time[i], 12000.0f);
  WriteSettings settings;
  settings.chunk_seconds = 0.2;
  std::vector<std::uint32_t> order;
  const auto bytes = encode_scene(scene, settings, &order);
  REQUIRE(bytes.ok());
  REQUIRE_FALSE(root_links(*bytes).empty());
  CHECK(issues_of(*bytes).empty());
  const auto read = read_scene(memory_source(*bytes));
  REQUIRE(read.ok());
  REQUIRE(order.size() == scene.gaussians.size());
  CHECK(fingerprints(read->gaussians) == fingerprints(scene.gaussians.gather(order)));
  for (std::size_t i = 0; i < order.size(); ++i)
    REQUIRE(read->importance[i] == scene.importance[order[i]]);
  CHECK(read->parts == scene.parts);
}

TEST_CASE("a damaged node is read from its copy, and without one its times are lost") {
  const Bytes intact = long_file();
  const std::vector<NodeLink> links = root_links(intact);
  REQUIRE(links.size() > 1);
  const NodeLink& link = links[1];
  REQUIRE(link.copy > link.offset);
  Bytes bytes = intact;
  bytes[link.offset + kRecordHeaderBytes + 20] ^= 1;
  const auto repaired = SceneReader::open(memory_source(bytes));
  REQUIRE(repaired.ok());
  CHECK(numbers_of((*repaired)->damage()) == std::set<int>{118});
  CHECK((*repaired)->lost_fragments().empty());
  CHECK(read_scene(memory_source(bytes))->gaussians.size() == kPrimitives);
  CHECK(issues_of(bytes).count(112) == 1);

  bytes[link.copy + 21] ^= 1;
  const auto reader = SceneReader::open(memory_source(bytes));
  REQUIRE(reader.ok());
  CHECK(numbers_of((*reader)->damage()) == std::set<int>{112});
  REQUIRE((*reader)->lost_fragments().size() == 1);
  CHECK((*reader)->lost_fragments()[0].range == link.needed);
  CHECK((*reader)->complete_ticks() == link.needed.begin);
  const auto complete = SceneReader::open(memory_source(intact));
  const double elsewhere = links[0].needed.begin;
  CHECK(offsets_at(**reader, elsewhere) == offsets_at(**complete, elsewhere));
  DamageReport report;
  const auto recovered = recover_scene(memory_source(bytes), report);
  REQUIRE(recovered.ok());
  CHECK(recovered->gaussians.size() < kPrimitives);
  CHECK(report.any());
}

TEST_CASE("the validator compares a node with its copy") {
  Bytes bytes = long_file();
  const NodeLink link = root_links(bytes)[1];
  bytes[link.copy + kRecordHeaderBytes + link.bytes - 1] ^= 1;
  seal_record(bytes, link.copy);
  const auto reader = SceneReader::open(memory_source(bytes));
  REQUIRE(reader.ok());
  CHECK((*reader)->damage().empty());
  CHECK(issues_of(bytes) == std::set<int>{316});
}

TEST_CASE("invalid links are reported by number") {
  const Bytes intact = long_file();
  FileHead head = head_of(intact);
  FileIndex index = head.index;
  const auto opened = [&](const NodeLink& link, const Bytes& page) {
    IndexNode root;
    root.links = {link};
    FileIndex none;
    FileMetadata metadata;
    metadata.scene.frames = kFrames;
    const Bytes meta = write_record(kMetadataTag, write_metadata(metadata));
    return file_of({meta, write_record(kIndexTag, write_index(none, root))}, page);
  };
  ByteWriter empty;
  write_node({}, empty);
  const Bytes page = write_record(kPageTag, empty.view());
  const std::uint64_t at = opened({{0, 1}, 300, 0, 2}, page).size() - page.size();
  REQUIRE(at > 127);
  const auto number = [&](const NodeLink& link, const Bytes& body) {
    const auto reader = SceneReader::open(memory_source(opened(link, body)));
    if (!reader.ok()) {
      const std::string& message = reader.status().message();
      return std::stoi(message.substr(message.rfind("issue ") + 6));
    }
    return (*reader)->damage().empty() ? 0 : -(*reader)->damage()[0].number;
  };
  const NodeLink good = {{0, 1}, at, 0, empty.size()};
  CHECK(number(good, page) == 0);
  const auto with = [&](auto change) {
    NodeLink link = good;
    change(link);
    return number(link, page);
  };
  CHECK(with([](NodeLink& l) { l.offset = 150; }) == 316);  // in the head
  CHECK(with([](NodeLink& l) { ++l.offset; }) == 316);      // past the end
  CHECK(with([](NodeLink& l) { l.needed = {1, 0}; }) == 316);
  CHECK(with([](NodeLink& l) { l.needed.end = NAN; }) == 316);
  CHECK(with([](NodeLink& l) { --l.bytes; }) == -317);  // reading continues
  CHECK(number(good, write_record(tag_of("NOTE"), empty.view())) == -317);
  Bytes damaged = page;
  damaged[1] ^= 1;
  CHECK(number(good, damaged) == -110);
}

TEST_CASE("at most eight links follow each other") {
  const auto open = [](int depth) {
    FileMetadata metadata;
    metadata.scene.frames = kFrames;
    const Bytes meta = write_record(kMetadataTag, write_metadata(metadata));
    std::uint64_t at = 0;
    Bytes body;
    Bytes index;
    for (int pass = 0; pass < 2; ++pass) {
      body.clear();
      for (int i = 1; i <= depth; ++i) {
        IndexNode node;
        ByteWriter last, other;
        write_node({}, last);
        if (i < depth) {
          // A node with a link has the same size for all offsets from 128 to 16383.
          node.links = {{{0, 1}, 200, 0, 24}};
          write_node(node, other);
          const std::uint64_t next = at + body.size() + kRecordHeaderBytes + other.size();
          node.links = {{{0, 1}, next, 0, i + 1 < depth ? other.size() : last.size()}};
          other = {};
          write_node(node, other);
        }
        const Bytes page = write_record(kPageTag, i < depth ? other.view() : last.view());
        body.insert(body.end(), page.begin(), page.end());
      }
      IndexNode root;
      ByteReader first(body);
      first.u64();
      root.links = {{{0, 1}, at == 0 ? 200 : at, 0, first.u64()}};
      index = write_record(kIndexTag, write_index({}, root));
      at = kHeaderBytes + meta.size() + index.size();
    }
    return SceneReader::open(memory_source(file_of({meta, index}, body)));
  };
  const auto good = open(8), deep = open(9);
  REQUIRE(good.ok());
  CHECK((*good)->damage().empty());
  REQUIRE(deep.ok());
  CHECK(numbers_of((*deep)->damage()) == std::set<int>{316});
}

TEST_CASE("a long recording is opened with few bytes, and followed") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  const auto sizes = record(path, 40, false, Profile::kQuantised, 4);
  const Bytes bytes = bytes_of(path);
  const auto prefix = [&](std::size_t fragments) {
    return Bytes(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(sizes[fragments]));
  };
  std::uint64_t count = 0;
  const auto at_35 = open_on_demand(std::make_unique<CountedSource>(prefix(35), count));
  CHECK(count < 4096);
  CHECK(at_35->segments().size() < 10);
  const auto grown = at_35->refreshed(memory_source(bytes));
  INFO(grown.status().message());
  REQUIRE(grown.ok());
  SceneReader* const reader = grown->get();
  CHECK(reader->metadata().frames == 400);
  const auto complete = open_scene(path);
  for (const double t : {395.0, 5.0, 123.0, 345.0, 355.0}) {
    REQUIRE(reader->load(t, t).ok());
    CHECK(offsets_at(*reader, t) == offsets_at(*complete, t));
  }
  REQUIRE(reader->load(-kAlways, kAlways).ok());
  CHECK(reader->segments().size() == complete->segments().size());
  CHECK(reader->damage().empty());
  // Another recording in its place is not mistaken for its continuation.
  record(folder / "other.stgs", 45, false, Profile::kQuantised, 5);
  const auto replaced = at_35->refreshed(memory_source(bytes_of(folder / "other.stgs")));
  CHECK(replaced.status().code() == StatusCode::kInvalidFile);
}

TEST_CASE("loading a long recording bit by bit takes few steps") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  record(path, 300, false, Profile::kQuantised, 5);
  const auto complete = open_scene(path);
  const auto reader = open_on_demand(memory_source(bytes_of(path)));
  int loads = 0;
  for (; !reader->unloaded().empty(); ++loads) {
    const double t = reader->unloaded().front().begin;
    REQUIRE(reader->load(t, t).ok());
  }
  CHECK(loads > 5);
  CHECK(loads < 60);
  CHECK(reader->segments().size() == complete->segments().size());
  CHECK(reader->damage().empty());
}
