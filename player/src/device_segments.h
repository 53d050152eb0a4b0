// SPDX-License-Identifier: Apache-2.0
// Which segments a backend's device holds: what a moment needs, within the timeline's budget.
#pragma once

#include <chrono>
#include <compare>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <vector>

#include "stgs/player/timeline.h"

namespace stgs::player {

// One thread. A backend says how a segment comes to its device and leaves it. What a timeline holds
// decoded comes in pieces: while somebody plays, one that is large comes with several pictures, and
// until it is all there what there was of the segment is drawn; what is needed soon comes ahead.
class DeviceSegments {
 public:
  virtual ~DeviceSegments() = default;
  // Makes what is alive at `seconds` present, drops what was needed least recently where the budget
  // asks for it, and gives what is to be drawn: all that is held of the moment, ascending. What is
  // held of another timeline goes. What uses segments must have ended, or come before in the
  // device's queue. Errors: those of Timeline::at, and of the device.
  Result<std::vector<Timeline::SegmentRef>> make_resident(Timeline& timeline, double seconds);
  std::uint64_t stored_primitives() const { return primitives_; }
  // Of what the last call of make_resident() was asked for: decoded, and left to later calls.
  std::uint64_t waiting_primitives() const { return waiting_; }
  // At the moments of the timeline that have most of them, as far as its budget has room: what
  // makes room for so many at once need not grow while it plays.
  struct Fullest {
    std::uint64_t primitives = 0, segments = 0;
  };
  const Fullest& peak() const { return fullest_; }
  // The device has no room for it.
  void forget_fullest() {
    fullest_ = {};
    no_room_ = true;
  }

 protected:
  int sh_degree() const { return sh_degree_; }
  // Primitives of a piece that is sent, at most.
  static constexpr std::size_t kMaxUploadPrimitives = std::size_t{1} << 16;
  // From now on the device holds a segment, in so many bytes, in place of what it held of it.
  void insert(std::uint32_t segment, std::uint64_t primitives, std::uint64_t bytes);
  // A segment that the device cannot decode, by the processor, as the timeline deals with damage.
  Status decode_on_cpu(Timeline& timeline, std::uint32_t segment);
  // Sends one that is decoded, all of it.
  Status send_all(std::uint32_t segment, const Gaussians4D& set);
  // Lets go of all. A backend calls it before its memory goes.
  void clear();
  using Clock = std::chrono::steady_clock;
  // The clock that limits what is sent for a picture while somebody plays.
  virtual Clock::time_point now() const { return Clock::now(); }

 private:
  struct Arriving {
    std::weak_ptr<const Gaussians4D> set;
    std::size_t sent = 0;  // of its primitives
  };
  // What was used in the latest call stays longest, and of that what matters most to the picture.
  enum class As { kAhead, kOutdated, kNeeded };  // kOutdated: until a better version has come
  struct Use {
    std::uint64_t call = 0;
    As as = As::kAhead;
    auto operator<=>(const Use&) const = default;
  };
  struct Held {
    std::uint64_t bytes = 0, primitives = 0;
    Use used;                              // the last
    std::weak_ptr<const Gaussians4D> set;  // Timeline::SegmentRef's, where it had one
  };
  using Segments = std::map<std::uint32_t, Held>;

  // Another timeline follows; nothing is held.
  virtual Status begin(const SceneReader& reader) = 0;
  // Makes room for segments of so many bytes, where the device has it, while it holds none.
  virtual void reserve(std::uint64_t bytes) = 0;
  // That a segment takes once it is held.
  virtual std::uint64_t bytes_of(std::uint64_t primitives) const = 0;
  // Decodes, and calls insert() for each that is sound and decode_on_cpu() for the others.
  virtual Status decode(Timeline& timeline, std::span<const std::uint32_t> segments) = 0;
  // Sends kMaxUploadPrimitives primitives of a set from `first` on, or the rest of it; all before
  // have been sent, and with 0 it begins anew. With the last it puts them in place of what it has
  // of the segment, and calls insert().
  virtual Status upload(std::uint32_t segment, const Gaussians4D& set, std::size_t first) = 0;
  // Gives back what was sent of a set that will not come to its end.
  virtual void cancel_upload(std::uint32_t segment) = 0;
  // Gives back what a segment has.
  virtual void release(std::uint32_t segment) = 0;

  Status change_to(const Timeline& timeline);
  void find_fullest(const Timeline& timeline);
  // Whether it is held as it is asked for, which is noted as its use; `now`: to be drawn.
  bool has(const Timeline::SegmentRef& asked, bool now);
  void drop(Segments::iterator segment);
  // Drops what was used less than that, the least first, until so many bytes more fit.
  void make_room(const Timeline& timeline, std::uint64_t more, const Use& least);
  // Leaves what the budget has room for, beside `more` bytes for what is needed now.
  void fit_ahead(const Timeline& timeline, std::uint64_t more,
                 std::vector<const Timeline::SegmentRef*>& ahead);
  // All that arrives but these.
  void abandon_others(std::span<const Timeline::SegmentRef* const> these);
  Status send_decoded(const Timeline& timeline,
                      std::span<const Timeline::SegmentRef* const> decoded,
                      std::span<const Timeline::SegmentRef* const> ahead);
  // One piece; whether there are more.
  Result<bool> send_piece(const Timeline::SegmentRef& needed);
  Clock::duration time_to_send(bool playing);
  Status make_present(Timeline& timeline, std::span<const Timeline::SegmentRef> needed,
                      double seconds);
  Status decode_all(Timeline& timeline, std::span<const std::uint32_t> segments);

  std::weak_ptr<const void> timeline_;
  int sh_degree_ = 0;
  Fullest fullest_;
  bool no_room_ = false;   // for it, as the device has told
  std::size_t known_ = 0;  // segments of the timeline that fullest_ is of
  Segments held_;
  std::map<std::uint32_t, Arriving> arriving_;
  std::uint64_t bytes_ = 0, primitives_ = 0, waiting_ = 0, call_ = 0;
  Clock::time_point called_;  // last
  bool played_ = false;       // then
};

}  // namespace stgs::player
