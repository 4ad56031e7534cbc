// The particles at an address (live.py: soil_bytes), asked for again and again if it is no data URL. They are
// drawn here, pixel by pixel: WebGL without a graphics card takes ten times as long.
const PERIOD_MS = 50;
const FOCUS = 0.65; // of the height: 75 degrees

export default {
  template: `<canvas class="soil" width="520" height="260" style="background: #f4f4f0; touch-action: none"></canvas>`,
  props: { url: String, run: String },
  watch: { url: "follow" },

  mounted() {
    const canvas = this.$el;
    canvas.onpointerdown = (event) => canvas.setPointerCapture(event.pointerId);
    canvas.onpointermove = (event) => {
      if (event.buttons) this.look(0.01 * event.movementX, 0.01 * event.movementY, 1);
    };
    canvas.onwheel = (event) => {
      event.preventDefault();
      this.look(0, 0, Math.exp(0.001 * event.deltaY));
    };
    this.follow();
  },

  unmounted() {
    this.mine = null;
  },

  methods: {
    async follow() {
      const mine = (this.mine = {});
      const { url, run } = this;
      const live = !url.startsWith("data:");
      this.fill(new ArrayBuffer(24), run);
      for (let time = -1; url && this.mine === mine; ) {
        const hidden = live && !this.$el.offsetParent;
        const asked = hidden ? Promise.reject() : fetch(live ? `${url}?after=${time}` : url);
        const content = await asked
          .then((answer) => (answer.status === 200 ? answer.arrayBuffer() : null))
          .catch(() => null);
        if (content && this.mine === mine) time = this.fill(content, run);
        if (!live) return;
        await new Promise((done) => setTimeout(done, PERIOD_MS));
      }
    },

    fill(content, run) {
      const count = (content.byteLength - 24) / 15;
      const [time, size, grain] = new Float64Array(content, 0, 3);
      this.places = new Float32Array(content, 24, 3 * count);
      this.colours = new Uint8Array(content, 24 + 12 * count);
      this.grain = grain;
      if (count && this.seen !== run) {
        [this.seen, this.turn, this.tilt, this.distance] = [run, 0, 0.6, 1.1 * size];
      }
      this.draw();
      return time;
    },

    look(turn, tilt, zoom) {
      this.turn += turn;
      this.tilt = Math.min(1.5, Math.max(-1.5, this.tilt + tilt));
      this.distance *= zoom;
      this.draw();
    },

    draw() {
      const { $el: canvas, places, colours, grain, turn, tilt, distance } = this;
      const { width, height } = canvas;
      const image = new ImageData(width, height);
      const pixels = new Uint32Array(image.data.buffer);
      const depths = new Float32Array(width * height).fill(Infinity);
      const [sine, cosine, down, ahead] = [Math.sin(turn), Math.cos(turn), Math.sin(tilt), Math.cos(tilt)];
      for (let i = 0; i < places.length; i += 3) {
        const away = cosine * places[i + 1] - sine * places[i];
        const depth = distance + ahead * away - down * places[i + 2];
        if (depth < grain) continue;
        const scale = (FOCUS * height) / depth;
        const left = Math.round(0.5 * width + scale * (cosine * places[i] + sine * places[i + 1]));
        const top = Math.round(0.5 * height - scale * (down * away + ahead * places[i + 2]));
        const side = Math.min(20, Math.max(1, Math.round(scale * grain)));
        const colour = (0xff << 24) | (colours[i + 2] << 16) | (colours[i + 1] << 8) | colours[i];
        for (let y = Math.max(0, top); y < Math.min(height, top + side); y++) {
          for (let x = Math.max(0, left); x < Math.min(width, left + side); x++) {
            const at = y * width + x;
            if (depth < depths[at]) [depths[at], pixels[at]] = [depth, colour];
          }
        }
      }
      canvas.getContext("2d").putImageData(image, 0, 0);
    },
  },
};
