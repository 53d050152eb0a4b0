// SPDX-License-Identifier: Apache-2.0
// The order of the records of a finished file, and its index (spec 5.2, 5.6, 10.2).
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "container/container.h"

namespace stgs {

// Divides an index into nodes of about kHeadTarget bytes, so that a reader needs few of them for a
// time, and lays out the body: each PAGE before the segments that it lists, then other records, and
// at last the copies of the PAGE records.
class BodyPlan {
 public:
  // Sets the offsets in `index`, whose entries have all other values. `head_bytes`: of the header
  // and the records of the head but INDX. `other_bytes`: of the records after the last segment.
  BodyPlan(FileIndex& index, std::span<const PartEntry> parts, std::uint32_t frames,
           std::uint64_t head_bytes, std::uint64_t other_bytes);
  ~BodyPlan();
  BodyPlan(const BodyPlan&) = delete;
  BodyPlan& operator=(const BodyPlan&) = delete;

  // The INDX record.
  std::vector<std::uint8_t> index_record() const;
  // A record of the body: of `index`, or a PAGE.
  struct Piece {
    std::uint64_t offset = 0;
    const RecordRange* record = nullptr;  // null: a PAGE
    std::vector<std::uint8_t> page;       // complete
  };
  // Returns the records in file order.
  std::vector<Piece> pieces() const;
  // Returns the offset of the other records.
  std::uint64_t others_at() const { return others_at_; }
  // Returns the end of the body, where COPY begins.
  std::uint64_t end() const { return end_; }

 private:
  struct Item;
  struct Node;

  std::vector<Item> items_of(std::uint32_t frames) const;
  std::uint64_t bytes_of(const std::vector<std::uint32_t>& items) const;
  std::unique_ptr<Node> divide(std::vector<std::uint32_t> items, const TickRange& range,
                               std::uint64_t target, int depth) const;
  void lay_out(std::uint64_t head_bytes, std::uint64_t other_bytes);
  void place(Node& node, std::uint64_t& at);
  void place_copies(Node& node, std::uint64_t& at);
  bool encode(Node& node, bool is_root);
  IndexNode content_of(const Node& node) const;
  void add_pages(const Node& node, std::vector<Piece>& out) const;

  FileIndex& index_;
  const std::span<const PartEntry> parts_;
  std::vector<Item> items_;
  std::unique_ptr<Node> root_;
  std::uint64_t others_at_ = 0, end_ = 0;
};

}  // namespace stgs
