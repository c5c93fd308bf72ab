"use strict";

/** A number as people write it; the same rule as pidtsm_core/written.py. */
function written(value, digits = 3) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (value === 0) return "0";
  const sign = value < 0 ? "−" : "";
  if (!Number.isFinite(value)) return `${sign}∞`;
  const [mantissa, power] = Math.abs(value).toExponential(digits - 1).split("e");
  const exponent = Number(power);
  const short = (text) => (text.includes(".") ? text.replace(/\.?0+$/, "") : text);
  if (exponent < -3 || exponent >= 6) {
    const raised = String(exponent).replace(/./g, (c) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(c)]);
    return short(mantissa) === "1" ? `${sign}10${raised}` : `${sign}${short(mantissa)}\u202f×\u202f10${raised}`;
  }
  const text = short(Number(`${mantissa}e${power}`).toFixed(Math.max(0, digits - 1 - exponent)));
  const [whole, part] = text.split(".");
  const grouped = Number(whole) >= 10000 ? whole.replace(/\B(?=(\d{3})+$)/g, "\u202f") : whole;
  return sign + grouped + (part ? `.${part}` : "");
}

/** A value with the unit that fits it; the same rule as pidtsm_core/written.py. */
function quantity(value, unit, digits = 3) {
  const size = Math.abs(value);
  if (size < 1e-12) return `0\u202f${unit}`;
  const [prefix, factor] = [["", 1], ["m", 1e3], ["µ", 1e6], ["n", 1e9]].find(([, each], i) => size * each >= 1 || i === 3);
  return `${written(factor * value, digits)}\u202f${prefix}${unit}`;
}
