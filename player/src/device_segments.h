// SPDX-License-Identifier: Apache-2.0
// Which segments a backend's device holds: what a moment needs, within the timeline's budget.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <vector>

#include "stgs/player/timeline.h"

namespace stgs::player {

// One thread. A backend says how a segment comes to its device and leaves it.
class DeviceSegments {
 public:
  virtual ~DeviceSegments() = default;
  // Makes what is alive at `seconds` present, drops what was needed least recently where the budget
  // asks for it, and gives what is to be drawn: all that is held of the moment, ascending. What is
  // held of another timeline goes. What uses segments must have ended; waits for what it sends.
  // Errors: those of Timeline::at, and of the device.
  Result<std::vector<Timeline::Needed>> hold(Timeline& timeline, double seconds);
  std::uint64_t stored_primitives() const { return primitives_; }

 protected:
  int sh_degree() const { return sh_degree_; }
  // From now on the device holds a segment, in so many bytes.
  void keep(std::uint32_t segment, std::uint64_t primitives, std::uint64_t bytes);
  // A segment that the device cannot decode, by the processor, as the timeline deals with damage.
  Status decode_here(Timeline& timeline, std::uint32_t segment);
  // Lets go of all. A backend calls it before its memory goes.
  void clear();

 private:
  struct Held {
    std::uint64_t bytes = 0, primitives = 0;
    std::uint64_t used = 0;                // number of the call that needed it last
    std::weak_ptr<const Gaussians4D> set;  // Timeline::Needed's, where it had one
  };
  using Segments = std::map<std::uint32_t, Held>;

  // Another timeline follows; nothing is held.
  virtual Status begin(const SceneReader& reader) = 0;
  // That a segment takes once it is held.
  virtual std::uint64_t bytes_of(std::uint64_t primitives) const = 0;
  // Decodes, and calls keep() for each that is sound and decode_here() for the others.
  virtual Status decode(Timeline& timeline, std::span<const std::uint32_t> segments) = 0;
  // Sends one that is decoded, and calls keep().
  virtual Status send(std::uint32_t segment, const Gaussians4D& set) = 0;
  // Gives back what a segment has.
  virtual void release(std::uint32_t segment) = 0;

  Status change_to(const Timeline& timeline);
  // Whether it is held as it is needed; where it has changed it is dropped.
  bool has(const Timeline::Needed& needed);
  void drop(Segments::iterator segment);
  Status make_present(Timeline& timeline, std::span<const Timeline::Needed> needed, double seconds);
  Status decode_all(Timeline& timeline, std::span<const std::uint32_t> segments);

  std::weak_ptr<const void> timeline_;
  int sh_degree_ = 0;
  Segments held_;
  std::uint64_t bytes_ = 0, primitives_ = 0, call_ = 0;
};

}  // namespace stgs::player
