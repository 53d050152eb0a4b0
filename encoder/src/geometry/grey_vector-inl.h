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
template <int kByte, class I>
HWY_INLINE GreyV corner(I corners) {
  const hn::RebindToUnsigned<GreyTag> du;
  const hn::RebindToSigned<GreyTag> di;
  const auto byte = hn::And(hn::ShiftRight<8 * kByte>(corners), hn::Set(du, 0xFFu));
  return hn::ConvertTo(GreyTag(), hn::BitCast(di, byte));
}

// Bilinear grey values between pixels, clamped to the image; (0, 0) is the centre of the first one.
HWY_INLINE GreyV grey_vector(const std::uint32_t* image, int width, int height, GreyV u, GreyV v) {
  const GreyTag d;
  const hn::RebindToSigned<GreyTag> di;
  const hn::RebindToUnsigned<GreyTag> du;
  const GreyV zero = hn::Zero(d);
  const GreyV x = hn::Min(hn::Max(u, zero), hn::Set(d, static_cast<float>(width - 1)));
  const GreyV y = hn::Min(hn::Max(v, zero), hn::Set(d, static_cast<float>(height - 1)));
  const auto x0 = hn::ConvertTo(di, x), y0 = hn::ConvertTo(di, y);
  const GreyV ax = hn::Sub(x, hn::ConvertTo(d, x0)), ay = hn::Sub(y, hn::ConvertTo(d, y0));
  const auto index = hn::Add(hn::Mul(y0, hn::Set(di, width)), x0);
  const auto corners = hn::GatherIndex(du, image, index);
  const GreyV left = corner<0>(corners), below_left = corner<2>(corners);
  const GreyV above = hn::MulAdd(ax, hn::Sub(corner<1>(corners), left), left);
  const GreyV below = hn::MulAdd(ax, hn::Sub(corner<3>(corners), below_left), below_left);
  return hn::MulAdd(ay, hn::Sub(below, above), above);
}

}  // namespace
}  // namespace stgs::encoder::geometry::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
