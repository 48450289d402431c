// Design codes, such as FF-0E3E-RK8M-94CX-9 (fractal_farm/ifs/design_code.py).

const ALPHABET = "0123456789ABCDEFGHJKMNPQRSTVWXYZ";
const POLYNOMIAL = 0b100101;
const GROUPS = 3;

/** The code of a design from its id of 32 hex digits. */
export function designCode(id) {
  const values = valuesOf(id.slice(0, 5 * GROUPS));
  const text = values.map((value) => ALPHABET[value]).join("");
  const groups = text.match(/.{4}/g);
  return `FF-${[...groups, ALPHABET[check(values)]].join("-")}`;
}

/** The hex digits with which ids begin that a code or part of one stands for, or hex digits as they are; null if none. */
export function digitsOf(text) {
  const plain = text.trim().toUpperCase();
  if (!plain.startsWith("FF-")) return /^[0-9A-F]{1,32}$/.test(plain) ? plain.toLowerCase() : null;
  const body = plain.slice(3).replace(/[- ]/g, "").replace(/[IL]/g, "1").replace(/O/g, "0");
  const letters = body.length === 4 * GROUPS + 1 ? body.slice(0, -1) : body;
  let bits = "";
  for (const letter of letters) {
    const value = ALPHABET.indexOf(letter);
    if (value < 0) return null;
    bits += value.toString(2).padStart(5, "0");
  }
  const digits = bits.slice(0, bits.length - (bits.length % 4)).match(/.{4}/g) ?? [];
  return digits.map((four) => parseInt(four, 2).toString(16)).join("");
}

function valuesOf(hex) {
  const bits = [...hex].map((digit) => parseInt(digit, 16).toString(2).padStart(4, "0")).join("");
  return bits.match(/.{5}/g).map((five) => parseInt(five, 2));
}

/** The sum of x^(n - i) values[i] over the field of 32 elements. */
function check(values) {
  let total = 0;
  for (const value of values) {
    total = (total ^ value) << 1;
    if (total & 32) total ^= POLYNOMIAL;
  }
  return total;
}
