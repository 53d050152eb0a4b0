// SPDX-License-Identifier: Apache-2.0
#include "container/body_plan.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>

#include "container/node.h"
#include "container/segment_keys.h"

namespace stgs {
namespace {

constexpr int kFanOut = 8;  // ranges of time into which a node is divided
// Estimates: bytes of the totals of INDX, of a run and of a link.
constexpr std::uint64_t kTotalsBytes = 256, kRunBytes = 56, kLinkBytes = 32;
constexpr std::uint64_t kMinRootBytes = 2048;

std::uint64_t varint_bytes(std::uint64_t v) {
  std::uint64_t bytes = 1;
  for (; v >= 0x80; v >>= 7) ++bytes;
  return bytes;
}

}  // namespace

// The records of one segment.
struct BodyPlan::Item {
  std::uint32_t part = 0;
  std::vector<SegmentEntry*> tiers;
  std::vector<FurtherEntry*> further;
  TickRange needed;         // closed, within the timeline
  std::uint64_t bytes = 0;  // of its row in a node, about

  const IndexEntry& place() const {
    return tiers.empty() ? further.front()->entry : tiers.front()->base;
  }
};

struct BodyPlan::Node {
  std::vector<std::uint32_t> items;  // by part and beginning
  std::vector<std::unique_ptr<Node>> children;
  std::uint64_t offset = 0, copy = 0;  // of its record
  std::vector<std::uint8_t> payload;
  TickRange needed;
};

BodyPlan::BodyPlan(FileIndex& index, std::span<const PartEntry> parts, std::uint32_t frames,
                   std::uint64_t head_bytes, std::uint64_t other_bytes)
    : index_(index), parts_(parts), items_(items_of(frames)) {
  std::vector<std::uint32_t> all(items_.size());
  for (std::uint32_t i = 0; i < all.size(); ++i) all[i] = i;
  const std::uint64_t used = head_bytes + kRecordHeaderBytes + kTotalsBytes;
  const std::uint64_t left = kHeadTarget - std::min(used, kHeadTarget);
  root_ =
      divide(std::move(all), {0.0, static_cast<double>(frames)}, std::max(left, kMinRootBytes), 0);
  lay_out(head_bytes, other_bytes);
}

BodyPlan::~BodyPlan() = default;

// Groups the records by segment, and sorts the segments by part and beginning.
std::vector<BodyPlan::Item> BodyPlan::items_of(std::uint32_t frames) const {
  using Key = std::tuple<std::uint32_t, double, int>;  // part, beginning, level descending
  const auto key_of = [this](const IndexEntry& entry, std::uint32_t part) {
    const bool persistent = entry.level < 0;
    return Key(part,
               persistent ? -1.0 : begin_of(entry.level, entry.slot, parts_[part].chunk_ticks),
               persistent ? -kMaxLevel - 1 : -entry.level);
  };
  std::map<Key, Item> items;
  for (SegmentEntry& segment : index_.segments) {
    Item& item = items[key_of(segment.base, segment.part)];
    item.part = segment.part;
    item.tiers.push_back(&segment);
    item.bytes += varint_bytes(segment.base.primitives) + varint_bytes(segment.base.bytes) +
                  varint_bytes(segment.sh.bytes);
  }
  for (FurtherEntry& further : index_.further) {
    Item& item = items[key_of(further.entry, further.part)];
    item.part = further.part;
    item.further.push_back(&further);
    item.bytes += 3 + varint_bytes(further.entry.bytes);
  }
  std::vector<Item> out;
  for (auto& [key, item] : items) {
    item.bytes += 4 + varint_bytes(item.tiers.size());
    const TickRange needed = needed_of(item.place(), parts_[item.part]);
    const double end = frames;
    item.needed.begin = std::clamp(needed.begin, 0.0, end);
    item.needed.end = std::clamp(needed.end, item.needed.begin, end);
    out.push_back(std::move(item));
  }
  return out;
}

std::uint64_t BodyPlan::bytes_of(const std::vector<std::uint32_t>& items) const {
  std::uint64_t bytes = 0;
  for (std::size_t k = 0; k < items.size(); ++k) {
    const Item& item = items_[items[k]];
    bytes += item.bytes;
    if (k == 0 || items_[items[k - 1]].part != item.part) bytes += kRunBytes;
  }
  return bytes;
}

// Puts the segments that fit a range of the timeline into the node of the shortest such range, and
// joins adjacent ranges as long as their segments fit one node.
std::unique_ptr<BodyPlan::Node> BodyPlan::divide(std::vector<std::uint32_t> items,
                                                 const TickRange& range, std::uint64_t target,
                                                 int depth) const {
  auto node = std::make_unique<Node>();
  node->items = std::move(items);
  const double width = (range.end - range.begin) / kFanOut;
  if (bytes_of(node->items) <= target || depth == kMaxLinkDepth || !(width > kChunkGrain)) {
    return node;
  }
  const auto bound = [&](int k) { return k == kFanOut ? range.end : range.begin + k * width; };
  const auto within = [&](int first, int last) {
    std::vector<std::uint32_t> out;
    for (const std::uint32_t i : node->items) {
      const TickRange& needed = items_[i].needed;
      if (needed.begin >= bound(first) && needed.end <= bound(last)) out.push_back(i);
    }
    return out;
  };
  for (int first = 0, last = 1; first < kFanOut; first = last, ++last) {
    std::vector<std::uint32_t> members = within(first, last);
    while (last < kFanOut) {
      std::vector<std::uint32_t> more = within(first, last + 1);
      if (bytes_of(more) > kHeadTarget) break;
      members = std::move(more);
      ++last;
    }
    if (members.empty()) continue;
    std::vector<std::uint32_t> rest;
    std::set_difference(node->items.begin(), node->items.end(), members.begin(), members.end(),
                        std::back_inserter(rest));
    node->items = std::move(rest);
    node->children.push_back(divide(std::move(members), {bound(first), bound(last)},
                                    kHeadTarget - kFanOut * kLinkBytes, depth + 1));
  }
  return node;
}

// Sizes depend on offsets and offsets on sizes. Repeats until none changes; they only grow.
void BodyPlan::lay_out(std::uint64_t head_bytes, std::uint64_t other_bytes) {
  do {
    std::uint64_t at = head_bytes + kRecordHeaderBytes + root_->payload.size();
    place(*root_, at);
    others_at_ = at;
    end_ = at + other_bytes;
    place_copies(*root_, end_);
  } while (encode(*root_, true));
}

// Sets the offsets of a node's segments and of the nodes below it.
void BodyPlan::place(Node& node, std::uint64_t& at) {
  const auto take = [&at](RecordRange& entry) {
    entry.offset = at;
    at += entry.bytes;
  };
  for (const std::uint32_t i : node.items) {
    for (SegmentEntry* tier : items_[i].tiers) take(tier->base);
    for (SegmentEntry* tier : items_[i].tiers) {
      if (tier->sh.bytes > 0) take(tier->sh);
    }
    for (FurtherEntry* further : items_[i].further) take(further->entry);
  }
  for (const auto& child : node.children) {
    child->offset = at;
    at += kRecordHeaderBytes + child->payload.size();
    place(*child, at);
  }
}

void BodyPlan::place_copies(Node& node, std::uint64_t& at) {
  for (const auto& child : node.children) {
    child->copy = at;
    at += kRecordHeaderBytes + child->payload.size();
    place_copies(*child, at);
  }
}

// Encodes a node and those below it. Returns whether the size of one has changed.
bool BodyPlan::encode(Node& node, bool is_root) {
  bool changed = false;
  for (const auto& child : node.children) changed |= encode(*child, false);
  const IndexNode content = content_of(node);
  node.needed = needed_of(content);
  const std::size_t before = node.payload.size();
  if (is_root) {
    node.payload = write_index(index_, content);
  } else {
    ByteWriter out;
    write_node(content, out);
    node.payload = out.take();
  }
  return changed || node.payload.size() != before;
}

IndexNode BodyPlan::content_of(const Node& node) const {
  IndexNode out;
  for (const auto& child : node.children) {
    out.links.push_back({child->needed, child->offset, child->copy, child->payload.size()});
  }
  std::uint32_t part = 0;
  for (const std::uint32_t i : node.items) {
    const Item& item = items_[i];
    if (out.runs.empty() || item.part != part) {
      part = item.part;
      out.runs.emplace_back().part = parts_[part];
    }
    IndexRun& run = out.runs.back();
    run.segments += item.tiers.size();
    run.further += item.further.size();
    for (const SegmentEntry* tier : item.tiers) out.segments.push_back(*tier);
    for (const FurtherEntry* further : item.further) out.further.push_back(*further);
  }
  return out;
}

std::vector<std::uint8_t> BodyPlan::index_record() const {
  return write_record(kIndexTag, root_->payload);
}

void BodyPlan::add_pages(const Node& node, std::vector<Piece>& out) const {
  for (const auto& child : node.children) {
    for (const std::uint64_t at : {child->offset, child->copy}) {
      out.push_back({at, nullptr, write_record(kPageTag, child->payload)});
    }
    add_pages(*child, out);
  }
}

std::vector<BodyPlan::Piece> BodyPlan::pieces() const {
  std::vector<Piece> out;
  for (const RecordRange* record : records_of(index_)) out.push_back({record->offset, record, {}});
  add_pages(*root_, out);
  std::sort(out.begin(), out.end(),
            [](const Piece& a, const Piece& b) { return a.offset < b.offset; });
  return out;
}

}  // namespace stgs
