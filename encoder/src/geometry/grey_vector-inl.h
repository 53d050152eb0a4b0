// SPDX-License-Identifier: Apache-2.0
// Bilinear grey values for vectors. Include after hwy/foreach_target.h, once per target.
#if defined(STGS_GREY_VECTOR_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef STGS_GREY_VECTOR_INL_H
#undef STGS_GREY_VECTOR_INL_H
#else
#define STGS_GREY_VECTOR_INL_H
#endif

#include <hwy/highway.h>
#include <cstdint>

HWY_BEFORE_NAMESPACE();
namespace stgs::encoder::geometry::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using GreyTag = hn::CappedTag<float, 16>;
using GreyV = hn::Vec<GreyTag>;

// Byte k of each lane, as a float.
template <int kByte, class D, class I>
HWY_INLINE hn::Vec<D> corner(D d, I corners) {
  const hn::RebindToUnsigned<D> du;
  const hn::RebindToSigned<D> di;
  const auto byte = hn::And(hn::ShiftRight<8 * kByte>(corners), hn::Set(du, 0xFFu));
  return hn::ConvertTo(d, hn::BitCast(di, byte));
}

// A grey image for bilinear values at many positions. Of 2^22 pixels at most.
template <class D>
class GreyImage {
 public:
  using V = hn::Vec<D>;

  // `corners`: as in StereoImage.
  HWY_INLINE GreyImage(const std::uint32_t* corners, int width, int height)
      : corners_(corners),
        width_(hn::Set(D(), static_cast<float>(width))),
        last_x_(hn::Set(D(), static_cast<float>(width - 1))),
        last_y_(hn::Set(D(), static_cast<float>(height - 1))) {}

  // Values clamped to the image; (0, 0) is the centre of the first pixel.
  HWY_INLINE V at(V u, V v) const {
    const D d;
    const hn::RebindToUnsigned<D> du;
    const V zero = hn::Zero(d), integers = hn::Set(d, kIntegers);
    const V x = hn::Min(hn::Max(u, zero), last_x_), y = hn::Min(hn::Max(v, zero), last_y_);
    const V x0 = hn::Floor(x), y0 = hn::Floor(y);
    const V ax = hn::Sub(x, x0), ay = hn::Sub(y, y0);
    const auto bits = hn::BitCast(du, hn::Add(hn::MulAdd(y0, width_, x0), integers));
    const auto index = hn::Sub(bits, hn::BitCast(du, integers));
    const auto corners = hn::GatherIndex(du, corners_, hn::BitCast(hn::RebindToSigned<D>(), index));
    const V left = corner<0>(d, corners), below_left = corner<2>(d, corners);
    const V above = hn::MulAdd(ax, hn::Sub(corner<1>(d, corners), left), left);
    const V below = hn::MulAdd(ax, hn::Sub(corner<3>(d, corners), below_left), below_left);
    return hn::MulAdd(ay, hn::Sub(below, above), above);
  }

 private:
  // 1.5 * 2^23: the last bits of the sum with an integer below 2^22 hold the integer. That is
  // faster than conversions, which handle overflow.
  static constexpr float kIntegers = 12582912.0f;

  const std::uint32_t* corners_;
  V width_, last_x_, last_y_;
};

}  // namespace
}  // namespace stgs::encoder::geometry::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
