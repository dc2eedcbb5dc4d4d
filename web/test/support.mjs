// Golden files, and what Rust loads them to.
import { readdirSync, readFileSync } from "node:fs";
import { checksum } from "../dist/test.js";

const folder = new URL("../../fixtures/golden/", import.meta.url);

export const golden = JSON.parse(readFileSync(new URL("golden.json", import.meta.url), "utf8"));

export function read(name) {
  return new Uint8Array(readFileSync(new URL(name, folder)));
}

export const names = readdirSync(folder).filter((name) => name.endsWith(".txf"));

const hash = (bytes) => checksum(new Uint8Array(bytes.buffer, bytes.byteOffset, bytes.byteLength)).toString(16).padStart(16, "0");

/** A texture as golden.json describes it. */
export function described({ form, layers, compressedBytes }) {
  return {
    compressed: 8 * compressedBytes,
    layers,
    form: {
      ...form,
      uniforms: hash(form.uniforms),
      planes: form.planes.map((plane) => ({ ...plane, data: hash(plane.data) })),
      blocks: form.blocks.map((blocks) => ({ ...blocks, words: hash(blocks.words), streams: hash(blocks.streams) })),
    },
  };
}

/** A file with other bytes in its sections, its checksums made right: as a forger writes it. */
export function resealed(bytes) {
  const file = bytes.slice();
  const view = new DataView(file.buffer);
  const count = view.getUint32(12, true);
  for (let entry = 32; entry < 32 + 40 * count; entry += 40) {
    const start = Number(view.getBigUint64(entry + 8, true)), length = Number(view.getBigUint64(entry + 16, true));
    view.setBigUint64(entry + 32, checksum(file.subarray(start, start + length)), true);
  }
  const summed = new Uint8Array([...file.subarray(0, 24), ...file.subarray(32, 32 + 40 * count)]);
  view.setBigUint64(24, checksum(summed), true);
  return file;
}

/** 32768x8 texels with mip levels, by `texfold compress long.png --codec dct --effort fast --mips`. */
export const LONG =
  "iVRYRg0KGgoCAAcABAAAALcDAAAAAAAAN2PodBSoEu5OT1RFAQAAAMAAAAAAAAAAlQAAAAAAAAC0AAAAAAAAAKAgRLMg0b0VTEFZTwAAAABVAQAAAAAAABwAAAAAAAAAHAAAAAAAAABg" +
  "5h262K/OYlJCQjABAAAAcQEAAAAAAAAmAgAAAAAAAIsGAAAAAAAAzPSnYQjAhShSQkQwAQAAAJcDAAAAAAAAIAAAAAAAAAAMDAAAAAAAAB8/ttgPUor8KLUv/SC0ZQQAwokeGWCtDkMM" +
  "/7TERlAtEAQBVOIC/1iahKQ0aAEPeS1JkKS5BbSFVXqFk6S47wqIfmiFz3aK4vGN7u0reTa058ySUkcKhxvD5dLC49sS9rylh3rmM9Hd0Yj2oXbV+fA40+XHc0RbziO9ubFEIcb+jF+L" +
  "Jcaeo3xsGUXGlhAFAEGJclQOBMrgTivKKk4DCAAAAAAAABAAAAABAAAAAQAAAACAAAAIAAAAKLUv/WCLBeUQALQYAv9/BwAIBdQIAAAAAQEDgABpAGMABAQFRgByDADR2jLGGGOMMRgA" +
  "cgCAMZn5WQG5GQJ52TkDmflZBLkZBXnZOQaZ+VkHuRkIedk5CZn5WQq5GQt52TkMDAAB3///X+AHP/h/Az/4wff//x8g8P///zcHNHz/H/iH/wO+f+Af/v97uO8H/MEPfvCDH/w9oPH/" +
  "A2jYlx6RSqxYsyv+jZ5v++z/81bJxKAegnAt2H+dgo5EElnlPpCQOE72/gRoA9x3Tax8SdJw7FBXHMz/wh9JCBGDKtN3lCUSpgIM2QH/DwAACAUUgQQWADgAc0oAf8D/H/D9A///f/8H" +
  "5P7/f/s/Ac7/Wt0AZ7wTiOzFh+y/03/4v0fQW8vf/Pif4AtodEdjDry89T8ifj1j+Qm6x5hZxyEw2dP/Af8BVAcNACEQJf8d/z/2/5wB5vxLblVdltM+ZupMix2bZK+suWKWHQPDTTkT" +
  "tygCPwCUBgIEBAAQKwP/9z8Z1lUj6zgMZQ8BB9QFAwQABwcBABSXAARPqIFcdSZpGSkqLKwBIGkmbcZCORSCGYjAgSCG4KZ4wqQtu24DOHvJCDt/BA/ecUWhbCBW1kruVIGx3RhC5hbp" +
  "PHtfYF9W6UklYd2i6vEPPAwMqpUWuac1gDCymQrH64hs98V80Q2UQdlDEEgUIrIXjv3CwDxgYZvTrgEonQrOadsVWucWqgomPT+zOX6EHyi1L/1gDAu1AAB49zYfIg/coSrvfwO5ATQA" +
  "AQD603dD";

/** A material of 136x136 texels: base colour, normals, roughness and opacity, by `texfold compress FOLDER --as material --bpp 1 --mips`. */
export const MATERIAL =
  "iVRYRg0KGgoCAAcABQAAAFAKAAAAAAAAqF1KkXNB2m5OT1RFAQAAAOgAAAAAAAAAvgAAAAAAAADhAAAAAAAAAPGD0GQudNI/TEFZTwAAAACmAQAAAAAAABwAAAAAAAAAHAAAAAAAAACA" +
  "P0pSG9E9EU1BUFMBAAAAwgEAAAAAAABKAAAAAAAAAE8AAAAAAAAA4NFhcRU3IVlSQkIwAQAAAAwCAAAAAAAAxQYAAAAAAACDBwAAAAAAAM9vwUbLmIxpUkJEMAAAAADRCAAAAAAAAH8B" +
  "AAAAAAAAfwEAAAAAAACybU/7jYbQcyi1L/0g4a0FACKMJxxweQP8/9/I1JIoNVUNsjQmUfLysLctyzX7zf1ay6EkjkNrrUBgu+c+5z7MsLYgIMyFITfG/qMWpU7qWtvubqFX1eOY1LnP" +
  "oDdZ2YkkSSZ10OM8yeqPrOyP/j574tC+G7b37gyL3hhVW/2XZ927Bm329nqHPdu7XfP8QJpJneDsaLe/640vZxxnUqDUH87Vv+8qCuceg3Z/dv1FAQwBBwA0w7AZNWbGDurCo9IxUNYe" +
  "uGIDCAAAAAAAAAgAAAABAAAABAAAAIgAAACIAAAAKLUv/SBPDQIAYsMMEaBvoOWeymEcN2GY/78zJWRJ+cbGaFpO2lo34cOvQgchmddHyxuIHqG+/OMsM8sL6AECBAA4CaIU/SDWBYgo" +
  "tS/9YIMG3TUAxGIghwCHAAgFiQYRAQABAQNyAF8AvAAzAyEAm/1mAuf/MwP1//8DKAAIGQAbAgAA1aMyMBIFAwUDBAAFAwMEAwMCf+D9/2DD+//Chff///+AH/zw4f7/B6KagcPfqe8T" +
  "2m7C94R/9ZzSxTm6fRsZuhjDAmfygsVI9YjvSdnq318YsEF+eYaj/3hmcEF2hmiB2/DeSgBeHfObePnYhBUfsMFZI32zyv9/LAQAYna1uU+ffp8xhUfbFI9JCka/X3sO1+eMTp4wXsSt" +
  "HrwxOIv2ITUlGQqdJsh9WpwiALo4M1ZZE1m7b5pfpZpOiv1fmF+mmoQWWyABPBgMY3azl1gdPr0y6kdqXs89jD2JlzksEqFVjyu4+gcB2ouB8W0G9fXpg7uKqpUhPwCAACwMiV4AGfyM" +
  "H1I8EZBfijiAYUdd+8nTrEgdQ79bG/Zfj3Nx4vSkbVXK3XM9X9JMuwys5F1OwvC0oEyPfrIGtLTgW8QAsE2gXEFKwb+6v1x3Pp76aMi5ke0UliwWTy2Y1obOeD8EmI/bHjxiQPIVMT1l" +
  "erR/2tnGk1xVWwwChyq9VwrHgaySFZ04nyG+0+yp1kpDxGyy8k/j7x9z338fpEoUWvMGXFdWAKULw25Y4miTMGsy7+//Ymp3Y6S+BGufzhaIQWhHf8B/T7MnNIRlOENls8R7BMU6Yl/A" +
  "qAEEfA+t4JwYOKEJiqvpf/df6F/4X6ycXCjP7C+nDli7r065qcQMI17OsuA/Ti3AAwFY/wE7JV9Qp/Zf2B9C4iAQABDJBQ4BATIDDQCX/WkC4P8xAwkA/wMhAAgGAOwAAACRW/8P+o8E" +
  "GfGxvb217jEsy3uc6KkUkoHyDuuc3CSwJKuBV1xajiNfWvi2+g7v15lu05Y+t3+MEnQrX4hYrdaylqtX5bTNfxWbOtyP+5fcPXm26oXPDI2eMwOcXj2TKdl1wBTDFj6kFhWAB4NhzI7y" +
  "lmp69+lTyQHQvPiIjuQHMS0QmIujbEN6egBAADaMxB8BAAEJBQwAAwEDhQBtAMMAmgLJ/wgD7AIT/2791wDjA47/BgYALQAAAC0ABAOBAHYA9gAABPf/GwALAP8Dyv/m/zYA/gMHFwDU" +
  "AAAAOmOFoxjADAYAAGAwAAAAf8D2/wMrvAPv3y98+P8PWMH2BKq0c4UY1/sChWxlPx3073RsWPi10XmAEbOdmyjt/4Sj+fzpnMM1hDH5uhyOnfmPxJm+Nkkmy2BAY06+I+w/fbc0a2oI" +
  "FpyiuEAIQMs26eMEpXuFE4GrFR8OvTA4mHzUltF5GQFBS+AJEOJNDNQALHLxOkAHfQAzBJwaG7kVIAGsNyoscE/yX4FsgribsEaK9FxaYAUCxJdvkOTb69/5v8xirdVPtVYJBmwH3xRt" +
  "L4DdArQHi4b5Px8ABQD/A/P/JQAPzf/c/zRQYwtfoGU21qiLNBw/au9lFp3QxICPsasnwQuSBkiYqRCOTuocjAAJBAEDgvkb5v/8A67/7v9SAP0DBQYAEREHAAQAAQEBSQcOAI8AAABD" +
  "EwRiAPgfQFEIH9XouTbAiXs8vR4fvj4tHhkdJnifG+yfCIhQpHAc5jg/l5D8A0Fwd0WXhSBGOYT3F/hFOXq7F7+jWf8PAAAAwlVgWxaS0JH+zVRXXYqTb0BokxJbjhgoVrk1uPzriBg3" +
  "aRE/r1X7P+DsBNA/PP/yf6M7f2J7fEdg+AfRf5GfjJ+cv04ojPso4I4o2/8GAAMAA0XqBhmTduvMRpavf3cRfFn3GZu/eUQYncYZx2Oic/lIczqUOVUq1Yp/xgYQEAECAQGaEQCsxdlD" +
  "YiAAAIDBDAM7vP//g/M/EYUFUUom3hz8Isrbvqv3tMtU+Ty1QeZGWsRN5KmUlp1yoqOLN5IQUYH5Xze8wndTOCla6J1pcLsb4Xbp20wD9/NBXqBFfB9obubfF9+rfekXvczFZIrA9N/o" +
  "v7UJKMmOEzzn2r/K2q4Vc9vHvAYZ+9aa/eryUqBjEbcJxyJ9jemYjK//TIC0CdD3RWr531Lmlk81dOefKEB1TJp+IAGaTasIcmMHIY+k+Wka0NrPGJRtUr6JI+MQvtpFVqvdhR0mX2H6" +
  "dZJgfP18CJsXF///////Dz8okEYkGJs7EZqiArNGpTkg6FUFw6k8yv4LBoaFKnaerDyA4cck0XZ/fIczio6sEhSAcwjcV4XMfwBJozjFoFrVkLsxMeT4zyz1FrCJrrCqYgCAUep2t6RM" +
  "lb4p47HULTVsOiJDmCEhPeErTAjvK/IG40Jo/rRnj+SvKbmxBbQbQ5Y3ngqdezrcRPIcCpvrwVEqRIgqUyYPcYLzEAsb0EEFeEcT43hfCYYFYgqCX/Yo2Mb0AwIRCwIRCyJNRbUBivUZ" +
  "4Qwqsf3Tn+74jNcCx+a+RMKGX/Vbeu07iUpUBDzRFQ+atZ/WBlgqNUC2KZQ/uAkMiHM+wPRQfMOlDNyZq/G2sLoyuP+ak6v9WOynIjmlmlMpojoEmxd+JMGoRePwkdT0mrHAFaFMAAAA" +
  "Ovn/2AxJsNTwC/ivWg4xF5kMY3Z7j19XS8IRSsIRSpqTCMIRSk6VAcIRSpqTCFgHWAcsFjo8Ui/x8b8IE9f4fVTyei5Fs/B6XlM11DCbXKx2r1vwrGfGvAWi4mbZjmmeGmAX3g1+9BmA" +
  "4R37Q//q/IoSAjSk88NDM4YX+mYmmLG1dprQGa1gDqZTsTc+cxQZfHSzZdGTKQAAgjC7HHUBk/wbK9wCk/wb/lM3M+0/tjBAaoWmWYPwvKT5oY1zElxmgqy3mcBPMn9hgiydArF6sTrh" +
  "n+rflyU1TeY2Uy+ZmudM";
